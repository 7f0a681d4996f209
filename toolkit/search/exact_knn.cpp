#include "toolkit/search/knn.h"
#include "toolkit/search/knn_engine.h"

namespace palpate::search {
namespace {}  // namespace

NeighbourTable exact_knn(const cloud::Cloud& cloud, int threads) {
  const KnnEngine engine(cloud, threads);
  const Kernels& kernel = kernels();
  NeighbourTable table;
  engine.run(
      [&kernel](std::uint32_t self, const Vec3& p, const Candidates& c, double radius_mm, Neighbours& out,
                KnnScratch& scratch) {
        const double covered = radius_mm * radius_mm;
        for (double guess = scratch.guess;; guess = larger_guess(guess)) {
          const bool all = !(guess < covered);
          kernel.keep_ball(c, p, all ? kNoLimit : guess, scratch);
          const double worst = kernel.choose_eight(self, scratch, out);
          // Candidates are complete up to the guess.
          if (!all && !(worst <= guess)) continue;
          scratch.guess = kGuessMarginSq * worst;
          return worst < covered || radius_mm == kNoLimit;
        }
      },
      table);
  return table;
}

}  // namespace palpate::search
