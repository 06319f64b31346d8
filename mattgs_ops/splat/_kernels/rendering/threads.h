// A small pool of threads that sleep while there is nothing to do (no spinning: on a shared machine
// a spinning thread takes the core from the one it waits for).
#pragma once

#include <cstdint>
#include <functional>

namespace mattgs {

// Runs task(0) .. task(tasks - 1), each once, on up to `threads` threads including the caller's,
// and returns when all have finished. With one thread everything runs inline, in order. The first
// exception is rethrown. Safe to call from several threads at once and after a fork.
void parallel(int threads, int64_t tasks, const std::function<void(int64_t)>& task);

}  // namespace mattgs
