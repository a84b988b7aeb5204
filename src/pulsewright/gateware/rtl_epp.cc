// Layout of transport.bus.EPP_ACCESS.
struct Access {
    int64_t cycle;
    uint8_t op, value, timeout, unused[5];
};

const int64_t RELEASE_CYCLES = 5;  // between a cycle that nobody acknowledged and the next one

// Runs until nWait is at `level_wanted`, for `patience` cycles at most. Sets `*seen`.
int64_t wait_for(Bench &bench, bool level_wanted, int64_t patience, bool *seen, Outputs *out) {
    int64_t written = 0;
    *seen = false;
    for (int64_t n = 0; n < patience && !*seen; n++) {
        written += bench.edge(out + written);
        written += bench.finish(out + written);
        *seen = level(bench.top.p_nwait) == level_wanted;
    }
    return written;
}

// Carries out accesses as a host does that answers each edge of nWait at once, so one takes 10
// cycles. Returns the number of rows written, early if `space` may not be enough for the next
// access. `*done` counts accesses; `*last_byte` is what was last on the bus.
int64_t bench_epp(void *handle, Access *accesses, int64_t count, int64_t *done, int nwait_idle,
                  int64_t patience, uint8_t *last_byte, Outputs *out, int64_t space) {
    Bench &bench = *static_cast<Bench *>(handle);
    int64_t written = 0;
    for (; *done < count; ++*done) {
        Access &access = accesses[*done];
        const bool address = access.op == 'A' || access.op == 'a';
        const bool write = access.op == 'A' || access.op == 'W';
        bench.inputs.naddrstr = bench.inputs.ndatastr = 1;
        bench.change();
        while (bench.cycle < access.cycle - 2) {  // it acts at the third edge of its strobe
            if (space - written < 2) return written;
            written += bench.edge(out + written);
        }
        if (space - written < 2 * patience + 1) return written;
        written += bench.finish(out + written);

        bench.inputs.nwrite = !write;
        bench.inputs.data_i = write ? access.value : *last_byte;
        (address ? bench.inputs.naddrstr : bench.inputs.ndatastr) = 0;
        bench.change();
        access.cycle = bench.cycle + 2;
        bool acknowledged, released;
        written += wait_for(bench, !nwait_idle, patience, &acknowledged, out + written);
        access.timeout = !acknowledged;
        if (write) {
            *last_byte = access.value;
        } else {
            if (acknowledged) *last_byte = level(bench.top.p_data__o);
            access.value = *last_byte;
        }
        bench.inputs.naddrstr = bench.inputs.ndatastr = 1;
        bench.change();
        if (acknowledged) {
            written += wait_for(bench, nwait_idle, patience, &released, out + written);
        } else {  // the board sees the release all the same
            written += wait_for(bench, !nwait_idle, RELEASE_CYCLES, &released, out + written);
        }
    }
    return written;
}
