#include "toolkit/neighbourhood/knn.h"
#include "toolkit/neighbourhood/knn_engine.h"

namespace palpate::neighbourhood {
namespace {}  // namespace

NeighbourTable exact_knn(const cloud::Cloud& cloud, int threads) {
  const KnnEngine engine(cloud, threads);
  const Kernels& kernel = kernels();
  NeighbourTable table;
  engine.run(
      [&kernel](std::uint32_t self, const Vec3& p, const Candidates& c, double radius_mm, Neighbours& out,
                Scratch& scratch) {
        const double covered = radius_mm * radius_mm;
        for (double guess = scratch.guess;; guess = larger_guess(guess)) {
          const bool all = !(guess < covered);
          kernel.keep_ball(c, p, all ? kEverything : guess, scratch);
          const double worst = kernel.choose_eight(self, scratch, out);
          // Up to the guess nothing was left out.
          if (!all && !(worst <= guess)) continue;
          scratch.guess = kGuessRoom * worst;
          return worst < covered || radius_mm == kEverything;
        }
      },
      table);
  return table;
}

}  // namespace palpate::neighbourhood
