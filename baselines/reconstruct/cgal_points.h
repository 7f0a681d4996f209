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

/// One member of a CgalPoint, as CGAL's property maps read and write it.
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
