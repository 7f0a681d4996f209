#include "toolkit/neighbourhood/knn.h"
#include "toolkit/neighbourhood/knn_engine.h"

namespace palpate::neighbourhood {

NeighbourTable exact_knn(const cloud::Cloud& cloud, int threads) {
  const KnnEngine engine(cloud, threads);
  NeighbourTable table;
  engine.run(
      [](std::uint32_t self, const Vec3& p, const Candidates& c, double radius_mm, Neighbours& out) {
        BestEight best;
        const std::size_t n = c.size();
        for (std::size_t i = 0; i < n; ++i) {
          const double dx = c.x[i] - p.x(), dy = c.y[i] - p.y(), dz = c.z[i] - p.z();
          const double square = dx * dx + dy * dy + dz * dz;
          if (square <= best.worst() && c.index[i] != self) best.offer(square, c.index[i]);
        }
        best.store(self, out);
        return best.worst() < radius_mm * radius_mm || radius_mm == std::numeric_limits<double>::infinity();
      },
      table);
  return table;
}

}  // namespace palpate::neighbourhood
