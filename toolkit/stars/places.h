// Internal to stars: the order in which points are stored.
#pragma once

#include <cstdint>
#include <vector>

#include "toolkit/cloud/cloud.h"

namespace palpate::stars {

/// Of each place the index of its point: along a Morton curve, then in blocks of near ones. Parallel, the
/// same for any number of threads.
[[nodiscard]] std::vector<std::uint32_t> places_of(const cloud::Cloud& cloud, int threads);
/// The points in that order, without what else the cloud knows. Parallel.
[[nodiscard]] cloud::Cloud sorted_cloud(const cloud::Cloud& cloud, const std::vector<std::uint32_t>& order,
                                        int threads);

}  // namespace palpate::stars
