// Runs a CXXRTL design over whole arrays: stimulus rows in, one row out for every cycle in which an
// output changed. The struct `p_top` comes before this text; Inputs, Outputs, `apply` and `sample`
// are generated from the ports.

#include <cstring>
#include <new>

namespace {

template <size_t Bits>
uint64_t level(const cxxrtl::value<Bits> &signal) {
    return signal.template get<uint64_t>();
}

template <size_t Bits>
uint64_t level(const cxxrtl::wire<Bits> &signal) {
    return signal.curr.template get<uint64_t>();
}

//PORTS//

struct Bench {
    cxxrtl_design::p_top top;
    int64_t cycle = 0;  // the next clock edge
    Inputs inputs{};
    Outputs outputs{};  // as last reported
    bool reported = false;
    bool stale = true;  // inputs changed since the design settled
};

// Outputs just after the edge, with the inputs of that edge still applied.
void clock(Bench &bench) {
    using bit = cxxrtl::value<1>;
    if (bench.stale) {
        apply(bench.top, bench.inputs);
        bench.top.p_clk = bit{0u};
        bench.top.step();
        bench.stale = false;
    }
    // A low phase in which nothing changes need not be evaluated.
    bench.top.prev_p_clk = bit{0u};
    bench.top.p_clk = bit{1u};
    bench.top.step();
}

// One cycle; true if it wrote a row to `out`.
bool advance(Bench &bench, Outputs *out) {
    clock(bench);
    Outputs now{};
    sample(bench.top, now);
    now.cycle = bench.outputs.cycle;
    bool changed = !bench.reported || std::memcmp(&now, &bench.outputs, sizeof now) != 0;
    if (changed) {
        now.cycle = bench.cycle;
        *out = bench.outputs = now;
        bench.reported = true;
    }
    bench.cycle++;
    return changed;
}

}  // namespace

extern "C" {

void *bench_new() { return new (std::nothrow) Bench; }
void bench_delete(void *bench) { delete static_cast<Bench *>(bench); }
int64_t bench_cycle(const void *bench) { return static_cast<const Bench *>(bench)->cycle; }

// Runs up to edge `end`, not included, or until `space` rows are written. `*used` counts the rows of
// stimulus that have been applied. Returns the number of rows written.
int64_t bench_run(void *handle, int64_t end, const Inputs *stimulus, int64_t rows, int64_t *used,
                  Outputs *out, int64_t space) {
    Bench &bench = *static_cast<Bench *>(handle);
    int64_t written = 0;
    while (bench.cycle < end && written < space) {
        while (*used < rows && stimulus[*used].cycle <= bench.cycle) {
            bench.inputs = stimulus[(*used)++];
            bench.stale = true;
        }
        written += advance(bench, out + written);
    }
    return written;
}

//EPP//
}
