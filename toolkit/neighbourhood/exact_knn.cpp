#include <algorithm>

#include "toolkit/neighbourhood/knn.h"
#include "toolkit/neighbourhood/knn_engine.h"

namespace palpate::neighbourhood {

NeighbourTable exact_knn(const cloud::Cloud& cloud, int threads) {
  const KnnEngine engine(cloud, threads);
  NeighbourTable table;
  engine.run(
      [](std::uint32_t self, const Vec3& p, const Candidates& c, double radius_mm, Neighbours& out) {
        // Distances first, in a loop without branches, then the choice: a block of candidates at a time.
        BestEight best;
        constexpr std::size_t kBlock = 64;
        double square[kBlock];
        for (std::size_t begin = 0; begin < c.size(); begin += kBlock) {
          const std::size_t n = std::min(kBlock, c.size() - begin);
          const double *x = c.x.data() + begin, *y = c.y.data() + begin, *z = c.z.data() + begin;
          for (std::size_t i = 0; i < n; ++i) {
            const double dx = x[i] - p.x(), dy = y[i] - p.y(), dz = z[i] - p.z();
            square[i] = dx * dx + dy * dy + dz * dz;
          }
          for (std::size_t i = 0; i < n; ++i)
            if (square[i] <= best.worst() && c.index[begin + i] != self)
              best.offer(square[i], c.index[begin + i]);
        }
        best.store(self, out);
        return best.worst() < radius_mm * radius_mm || radius_mm == std::numeric_limits<double>::infinity();
      },
      table);
  return table;
}

}  // namespace palpate::neighbourhood
