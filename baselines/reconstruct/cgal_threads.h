// CGAL's parallel algorithms on so many threads as were asked for. Include in .cpp files of CGAL's units
// alone.
#pragma once

#include <CGAL/tags.h>

#include <cstddef>
#include <exception>

#include "toolkit/core/parallel.h"

#ifndef CGAL_LINKED_WITH_TBB
#error "CGAL's parallel algorithms need oneTBB: see CMakeLists.txt"
#endif

namespace palpate::baselines {

/// Calls work(tag) with CGAL's tag for one thread or for several. CGAL takes as many as there are where it is
/// called; inside the wrapper's own parallel work these are `threads` (0: all). What it throws is thrown
/// here. For algorithms that give each point its own output: the same for any number of threads.
template <class Work>
void with_cgal_threads(int threads, const Work& work) {
  if (threads == 1) return work(CGAL::Sequential_tag());
  constexpr std::size_t kWorkAndRoom =
      2;  // of two tasks the second is empty: a single one would get no threads
  std::exception_ptr failure;
  parallel_chunks(kWorkAndRoom, 1, threads, [&](std::size_t begin, std::size_t) {
    if (begin > 0) return;
    try {
      work(CGAL::Parallel_tag());
    } catch (...) {
      failure = std::current_exception();
    }
  });
  if (failure) std::rethrow_exception(failure);
}

}  // namespace palpate::baselines
