// Points as CGAL's point set processing takes them. Include in .cpp files of CGAL's units alone.
#pragma once

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/property_map.h>

#include <cstdint>
#include <vector>

#include "toolkit/cloud/cloud.h"

namespace palpate::baselines {

using CgalKernel = CGAL::Exact_predicates_inexact_constructions_kernel;
struct CgalPoint {
  CgalKernel::Point_3 place;
  CgalKernel::Vector_3 normal;
  std::uint32_t index;
  /// CGAL compares with a default to learn whether it was given constraints.
  friend bool operator==(const CgalPoint& a, const CgalPoint& b) noexcept { return a.index == b.index; }
};

struct CgalPlaceMap {
  using key_type = CgalPoint;
  using value_type = CgalKernel::Point_3;
  using reference = const CgalKernel::Point_3&;
  using category = boost::lvalue_property_map_tag;
  friend reference get(CgalPlaceMap, const CgalPoint& p) { return p.place; }
  friend void put(CgalPlaceMap, CgalPoint& p, const value_type& to) { p.place = to; }
  const value_type& operator[](const CgalPoint& p) const { return p.place; }
};
struct CgalNormalMap {
  using key_type = CgalPoint;
  using value_type = CgalKernel::Vector_3;
  using reference = const CgalKernel::Vector_3&;
  using category = boost::lvalue_property_map_tag;
  friend reference get(CgalNormalMap, const CgalPoint& p) { return p.normal; }
  friend void put(CgalNormalMap, CgalPoint& p, const value_type& to) { p.normal = to; }
};

/// Relative to the cloud's origin and divided by `unit_mm`, so that CGAL's own tolerances see numbers about
/// 1; without normals.
inline std::vector<CgalPoint> cgal_points(const cloud::Cloud& cloud, double unit_mm) {
  std::vector<CgalPoint> points;
  points.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 p = cloud.local_mm(i) / unit_mm;
    points.push_back({{p.x(), p.y(), p.z()}, CGAL::NULL_VECTOR, static_cast<std::uint32_t>(i)});
  }
  return points;
}
inline Vec3 place_of(const CgalKernel::Point_3& p) {
  return {p.x(), p.y(), p.z()};
}

}  // namespace palpate::baselines
