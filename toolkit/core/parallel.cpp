#ifndef TBB_PREVIEW_WAITING_FOR_WORKERS
#define TBB_PREVIEW_WAITING_FOR_WORKERS 1  // oneTBB before 2021.6 needs it for tbb::finalize
#endif
#include "toolkit/core/parallel.h"

#include <algorithm>
#include <atomic>
#include <map>
#include <mutex>
#include <thread>
#include <vector>

#ifndef PALPATE_STD_THREADS
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>
#include <tbb/version.h>
#endif

namespace palpate {
#ifndef PALPATE_STD_THREADS
namespace {

/// One arena for each number of threads: oneTBB 2021.8 never frees 7 KB of every arena.
class Arenas {
 public:
  tbb::task_arena& with(int threads) {
    const std::lock_guard lock(mutex_);
    return arenas_.try_emplace(threads, threads).first->second;
  }
  /// The next use of an arena makes its threads anew.
  void terminate() {
    const std::lock_guard lock(mutex_);
    for (auto& arena : arenas_) arena.second.terminate();
  }

 private:
  std::mutex mutex_;
  std::map<int, tbb::task_arena> arenas_;
};

Arenas& arenas() {
  static Arenas all;
  return all;
}

}  // namespace
#endif

int available_threads() noexcept {
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

std::pair<std::string, std::string> parallel_library() {
#ifdef PALPATE_STD_THREADS
  return {"std::thread", "of the compiler"};
#else
  return {"oneTBB", TBB_runtime_version()};
#endif
}

bool stop_idle_workers() {
#ifdef PALPATE_STD_THREADS
  return false;
#else
  arenas().terminate();
  tbb::task_scheduler_handle threads{tbb::attach{}};
  return tbb::finalize(threads, std::nothrow);
#endif
}

void parallel_chunks(std::size_t count, std::size_t grain, int threads,
                     const std::function<void(std::size_t, std::size_t)>& body) {
  if (count == 0) return;
  if (grain == 0) grain = 1;
  if (threads <= 0) threads = available_threads();
#ifndef PALPATE_STD_THREADS
  threads = std::min(threads, available_threads());  // more would make oneTBB warn
#endif
  const std::size_t chunks = (count + grain - 1) / grain;
  const auto run = [&](std::size_t chunk) { body(chunk * grain, std::min(count, (chunk + 1) * grain)); };
  if (threads == 1 || chunks == 1) {
    for (std::size_t chunk = 0; chunk < chunks; ++chunk) run(chunk);
    return;
  }
#ifdef PALPATE_STD_THREADS
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t chunk = next.fetch_add(1); chunk < chunks; chunk = next.fetch_add(1)) run(chunk);
  };
  std::vector<std::thread> pool;
  for (int i = 1; i < threads; ++i) pool.emplace_back(work);
  work();
  for (std::thread& t : pool) t.join();
#else
  const auto all = [&] { tbb::parallel_for(std::size_t{0}, chunks, run); };
  if (threads == available_threads()) return all();
  arenas().with(threads).execute(all);
#endif
}

}  // namespace palpate
