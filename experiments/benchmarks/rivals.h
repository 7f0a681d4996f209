// Eight nearest neighbours of every point by other people's trees, one thread, for comparison with ours. Each
// builds its index and asks it once a point; what is returned is a sum of indices, so that nothing is
// optimised away.
#pragma once

#include <cstdint>

#include "toolkit/cloud/cloud.h"

namespace palpate::benchmarks {

[[nodiscard]] std::uint64_t knn_nanoflann(const cloud::Cloud& cloud);
[[nodiscard]] std::uint64_t knn_cgal(const cloud::Cloud& cloud);
[[nodiscard]] std::uint64_t knn_pcl(const cloud::Cloud& cloud);

}  // namespace palpate::benchmarks
