// Seconds of a rendering's passes.
#pragma once

#include <time.h>

namespace mattgs {

// Gives the time since the last call, or since it was made: of the calling thread's own processor
// time where it works alone, so that other programs' load does not count, else of the wall clock.
class Stopwatch {
public:
    explicit Stopwatch(int threads)
        : clock_(threads > 1 ? CLOCK_MONOTONIC : CLOCK_THREAD_CPUTIME_ID), last_(now()) {}

    void lap(double& seconds) {
        const double t = now();
        seconds = t - last_;
        last_ = t;
    }

private:
    double now() const {
        timespec t{};
        clock_gettime(clock_, &t);
        return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
    }

    clockid_t clock_;
    double last_;
};

}  // namespace mattgs
