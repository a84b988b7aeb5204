// Layout of transport.bus.EPP_ACCESS.
struct Access {
    int64_t cycle;
    uint8_t op, value, timeout, unused[5];
};

// Carries out accesses as a host does that answers each edge of nWait at once, so one takes 10
// cycles. Stops early where `space` rows may not be enough for the next access. `*done` counts
// accesses; `*last_byte` is what was last on the bus. Returns the number of rows written.
int64_t bench_epp(void *handle, Access *accesses, int64_t count, int64_t *done, int nwait_idle,
                  int64_t patience, uint8_t *last_byte, Outputs *out, int64_t space) {
    Bench &bench = *static_cast<Bench *>(handle);
    int64_t written = 0;
    if (!(bench.inputs.naddrstr && bench.inputs.ndatastr)) {  // nobody has driven the pins yet
        bench.inputs.nwrite = bench.inputs.naddrstr = bench.inputs.ndatastr = 1;
        bench.stale = true;
    }
    for (; *done < count; ++*done) {
        Access &access = accesses[*done];
        bool address = access.op == 'A' || access.op == 'a';
        bool write = access.op == 'A' || access.op == 'W';
        while (bench.cycle < access.cycle - 2) {  // acts at the third edge of its strobe
            if (written == space) return written;
            written += advance(bench, out + written);
        }
        if (space - written < 2 * patience) return written;

        bench.inputs.nwrite = !write;
        bench.inputs.data_i = write ? access.value : *last_byte;
        (address ? bench.inputs.naddrstr : bench.inputs.ndatastr) = 0;
        bench.stale = true;
        access.cycle = bench.cycle + 2;
        bool acknowledged = false;
        for (int64_t n = 0; n < patience && !acknowledged; n++) {
            written += advance(bench, out + written);
            acknowledged = level(bench.top.p_nwait) != (uint64_t)nwait_idle;
        }
        access.timeout = !acknowledged;
        if (write) {
            *last_byte = access.value;
        } else {
            if (acknowledged) *last_byte = level(bench.top.p_data__o);
            access.value = *last_byte;
        }
        bench.inputs.naddrstr = bench.inputs.ndatastr = 1;
        bench.stale = true;
        for (int64_t n = 0; n < patience && acknowledged; n++) {
            written += advance(bench, out + written);
            acknowledged = level(bench.top.p_nwait) != (uint64_t)nwait_idle;
        }
    }
    return written;
}
