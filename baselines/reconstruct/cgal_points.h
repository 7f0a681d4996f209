// Points as CGAL's point set processing takes them. CGAL's parallel algorithms run on a given number of
// threads (in units with CGAL_LINKED_WITH_TBB). Only for .cpp files of CGAL units.
#pragma once

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/property_map.h>
#include <CGAL/tags.h>

#include <cstddef>
#include <cstdint>
#include <exception>
#include <vector>

#include <palpate/cloud.h>
#include "toolkit/core/parallel.h"

namespace palpate::baselines {

using CgalKernel = CGAL::Exact_predicates_inexact_constructions_kernel;
struct CgalPoint {
  CgalKernel::Point_3 place;
  CgalKernel::Vector_3 normal;
  std::uint32_t index;
  /// CGAL compares with a default to detect constraints.
  friend bool operator==(const CgalPoint& a, const CgalPoint& b) noexcept { return a.index == b.index; }
};

template <class Value, Value CgalPoint::*member>
struct CgalMap {
  using key_type = CgalPoint;
  using value_type = Value;
  using reference = const Value&;
  using category = boost::lvalue_property_map_tag;
  friend reference get(CgalMap, const CgalPoint& p) { return p.*member; }
  friend void put(CgalMap, CgalPoint& p, const Value& to) { p.*member = to; }
  const Value& operator[](const CgalPoint& p) const { return p.*member; }
};
using CgalPlaceMap = CgalMap<CgalKernel::Point_3, &CgalPoint::place>;
using CgalNormalMap = CgalMap<CgalKernel::Vector_3, &CgalPoint::normal>;

/// Relative to the cloud's origin and divided by `unit_mm`, so that CGAL's tolerances see numbers near 1;
/// without normals.
inline std::vector<CgalPoint> cgal_points(const cloud::Cloud& cloud, double unit_mm) {
  std::vector<CgalPoint> points;
  points.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 p = cloud.local_mm(i) / unit_mm;
    points.push_back({{p.x(), p.y(), p.z()}, CGAL::NULL_VECTOR, static_cast<std::uint32_t>(i)});
  }
  return points;
}
/// Those whose normal (by index in the cloud) is not zero, with it.
inline std::vector<CgalPoint> with_normals(const std::vector<CgalPoint>& points,
                                           const std::vector<Vec3>& normals) {
  std::vector<CgalPoint> with;
  for (const CgalPoint& point : points) {
    const Vec3& n = normals[point.index];
    if (n == Vec3::Zero()) continue;
    with.push_back(point);
    with.back().normal = {n.x(), n.y(), n.z()};
  }
  return with;
}
inline Vec3 place_of(const CgalKernel::Point_3& p) {
  return {p.x(), p.y(), p.z()};
}

#ifdef CGAL_LINKED_WITH_TBB
/// Calls work(tag) with CGAL's sequential or parallel tag on `threads` (0: all); passes exceptions on. For
/// algorithms with separate output per point, whose results do not depend on `threads`.
template <class Work>
void with_cgal_threads(int threads, const Work& work) {
  if (threads == 1) return work(CGAL::Sequential_tag());
  constexpr std::size_t kWorkAndRoom = 2;  // the second task is empty: a single task would get no threads
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
#endif

}  // namespace palpate::baselines
