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

// Outputs just after edge n are those that the design settles to before edge n + 1 while the inputs
// stay. So one evaluation of a cycle gives both the outputs after the edge before it and the next
// state, and only a change of inputs needs an evaluation of its own.
struct Bench {
    cxxrtl_design::p_top top;
    int64_t cycle = 0;  // the next clock edge
    Inputs inputs{};
    Outputs outputs{};  // as last reported
    bool sampled = true;  // the outputs after the edge before `cycle` have been looked at
    bool reported = false;

    // Evaluates until nothing changes, without an edge.
    void settle() {
        top.p_clk = cxxrtl::value<1>{0u};
        top.step();
    }

    // Writes a row to `out` if the outputs after the last edge differ from the row before.
    int64_t sample_to(Outputs *out) {
        sampled = true;
        Outputs now{};
        sample(top, now);
        now.cycle = outputs.cycle;
        if (reported && std::memcmp(&now, &outputs, sizeof now) == 0) return 0;
        now.cycle = cycle - 1;
        *out = outputs = now;
        reported = true;
        return 1;
    }

    // Settles after the last edge; returns the number of rows written, 0 or 1.
    int64_t finish(Outputs *out) {
        if (sampled) return 0;
        settle();
        return sample_to(out);
    }

    // Lets changed inputs act from the next edge on; `finish` comes first.
    void change() {
        apply(top, inputs);
        settle();
    }

    // One clock edge; reports the outputs after the one before. Returns 0 or 1 rows.
    int64_t edge(Outputs *out) {
        int64_t rows = 0;
        top.prev_p_clk = cxxrtl::value<1>{0u};
        top.p_clk = cxxrtl::value<1>{1u};
        bool settled = top.eval();
        if (!sampled) rows = sample_to(out);
        top.commit();
        if (!settled) top.step();
        cycle++;
        sampled = false;
        return rows;
    }
};

}  // namespace

extern "C" {

void *bench_new() { return new (std::nothrow) Bench; }
void bench_delete(void *bench) { delete static_cast<Bench *>(bench); }
int64_t bench_cycle(const void *bench) { return static_cast<const Bench *>(bench)->cycle; }

// Runs up to edge `end`, not included, or until fewer than two of `space` rows are left. `*used`
// counts the rows of stimulus that have been applied. Returns the number of rows written.
int64_t bench_run(void *handle, int64_t end, const Inputs *stimulus, int64_t rows, int64_t *used,
                  Outputs *out, int64_t space) {
    Bench &bench = *static_cast<Bench *>(handle);
    int64_t written = 0;
    while (bench.cycle < end && space - written >= 2) {
        if (*used < rows && stimulus[*used].cycle <= bench.cycle) {
            written += bench.finish(out + written);
            bench.inputs = stimulus[(*used)++];
            bench.change();
            continue;
        }
        written += bench.edge(out + written);
    }
    if (bench.cycle >= end) written += bench.finish(out + written);
    return written;
}

//EPP//
}
