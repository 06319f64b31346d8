#include "rendering/threads.h"

#include <unistd.h>

#include <atomic>
#include <condition_variable>
#include <exception>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

namespace mattgs {
namespace {

struct Job {
    Job(const std::function<void(int64_t)>& t, int64_t n) : task(t), tasks(n) {}

    const std::function<void(int64_t)>& task;
    int64_t tasks;
    std::atomic<int64_t> next{0};
    std::exception_ptr error;
    std::mutex error_mutex;

    void work() {
        for (int64_t i; (i = next.fetch_add(1, std::memory_order_relaxed)) < tasks;) {
            try {
                task(i);
            } catch (...) {
                const std::lock_guard<std::mutex> lock(error_mutex);
                if (!error) error = std::current_exception();
                next = tasks;
            }
        }
    }
};

class Pool {
public:
    // Only one job at a time has the pool's threads; others run on their caller's alone.
    void run(int threads, Job& job) {
        const std::unique_lock<std::mutex> owner(owner_, std::try_to_lock);
        if (!owner.owns_lock()) return job.work();
        const int helpers = threads - 1;
        while (static_cast<int>(threads_.size()) < helpers)
            threads_.emplace_back([this, k = static_cast<int>(threads_.size())] { loop(k); });
        {
            const std::lock_guard<std::mutex> lock(mutex_);
            job_ = &job;
            wanted_ = busy_ = helpers;
            ++round_;
        }
        wake_.notify_all();
        job.work();
        std::unique_lock<std::mutex> lock(mutex_);
        done_.wait(lock, [this] { return busy_ == 0; });
        job_ = nullptr;
    }

private:
    void loop(int k) {
        uint64_t seen = 0;
        std::unique_lock<std::mutex> lock(mutex_);
        for (;;) {
            wake_.wait(lock, [&] { return round_ != seen && k < wanted_ && job_; });
            seen = round_;
            Job* job = job_;
            lock.unlock();
            job->work();
            lock.lock();
            if (--busy_ == 0) done_.notify_one();
        }
    }

    std::mutex owner_, mutex_;
    std::condition_variable wake_, done_;
    std::vector<std::thread> threads_;
    Job* job_ = nullptr;
    int wanted_ = 0, busy_ = 0;
    uint64_t round_ = 0;
};

// A forked child has none of its parent's threads, so it gets a pool of its own. Pools are never
// destroyed: their threads sleep until the process ends.
Pool& pool() {
    static std::mutex mutex;
    static Pool* current = nullptr;
    static pid_t owner = 0;
    const std::lock_guard<std::mutex> lock(mutex);
    if (!current || owner != getpid()) {
        current = new Pool;
        owner = getpid();
    }
    return *current;
}

}  // namespace

void parallel(int threads, int64_t tasks, const std::function<void(int64_t)>& task) {
    if (tasks < threads) threads = static_cast<int>(tasks);
    if (threads <= 1) {
        for (int64_t i = 0; i < tasks; ++i) task(i);
        return;
    }
    Job job(task, tasks);
    pool().run(threads, job);
    if (job.error) std::rethrow_exception(job.error);
}

}  // namespace mattgs
