#include "toolkit/neighbourhood/knn.h"
#include "toolkit/neighbourhood/knn_engine.h"

namespace palpate::neighbourhood {
namespace {

/// The eighth neighbour's squared distance is guessed from the point before, with a quarter of the distance
/// to spare.
constexpr double kGuessRoom = 1.25 * 1.25;

}  // namespace

NeighbourTable exact_knn(const cloud::Cloud& cloud, int threads) {
  const KnnEngine engine(cloud, threads);
  NeighbourTable table;
  engine.run(
      [](std::uint32_t self, const Vec3& p, const Candidates& c, double radius_mm, Neighbours& out,
         Scratch& scratch) {
        square_distances(c, p, scratch);
        keep_within(scratch.guess, scratch);
        // The point itself and eight others; fewer: the guess was too small.
        if (scratch.kept.size() <= kNeighbours) keep_within(kEverything, scratch);
        const double worst = choose_eight(self, c, scratch.key, scratch.kept, out);
        scratch.guess = kGuessRoom * worst;
        return worst < radius_mm * radius_mm || radius_mm == kEverything;
      },
      table);
  return table;
}

}  // namespace palpate::neighbourhood
