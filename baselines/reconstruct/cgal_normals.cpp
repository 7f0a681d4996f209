// CGAL's normals: a unit of its own, since its point set processing takes long to compile.
#include "baselines/reconstruct/oriented_normals.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Random.h>
#include <CGAL/jet_estimate_normals.h>
#include <CGAL/mst_orient_normals.h>
#include <CGAL/pca_estimate_normals.h>
#include <CGAL/property_map.h>

namespace palpate::baselines {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
struct Oriented {
  Kernel::Point_3 place;
  Kernel::Vector_3 normal;
  std::uint32_t index;
  /// CGAL compares with a default to learn whether it was given constraints.
  friend bool operator==(const Oriented& a, const Oriented& b) noexcept { return a.index == b.index; }
};

struct PlaceMap {
  using key_type = Oriented;
  using value_type = Kernel::Point_3;
  using reference = const Kernel::Point_3&;
  using category = boost::lvalue_property_map_tag;
  friend reference get(PlaceMap, const Oriented& p) { return p.place; }
  friend void put(PlaceMap, Oriented& p, const value_type& to) { p.place = to; }
  const value_type& operator[](const Oriented& p) const { return p.place; }
};
struct NormalMap {
  using key_type = Oriented;
  using value_type = Kernel::Vector_3;
  using reference = const Kernel::Vector_3&;
  using category = boost::lvalue_property_map_tag;
  friend reference get(NormalMap, const Oriented& p) { return p.normal; }
  friend void put(NormalMap, Oriented& p, const value_type& to) { p.normal = to; }
};

}  // namespace

void seed_cgal() {
  CGAL::get_default_random() = CGAL::Random(0);
}

std::vector<Vec3> cgal_normals(const MethodInput& input, bool jets, unsigned k,
                               render::PreparePhases& phases) {
  phases.begin("normals");
  std::vector<Oriented> points;
  points.reserve(input.cloud.size());
  for (std::size_t i = 0; i < input.cloud.size(); ++i) {
    const Vec3 p = input.cloud.local_mm(i) / input.spacing_mm;
    points.push_back({{p.x(), p.y(), p.z()}, CGAL::NULL_VECTOR, static_cast<std::uint32_t>(i)});
  }
  const auto parameters = CGAL::parameters::point_map(PlaceMap()).normal_map(NormalMap());
  if (jets)
    CGAL::jet_estimate_normals<CGAL::Sequential_tag>(points, k, parameters);
  else
    CGAL::pca_estimate_normals<CGAL::Sequential_tag>(points, k, parameters);
  phases.end();
  phases.begin("orientation of normals");
  const auto unoriented = CGAL::mst_orient_normals(points, k, parameters);
  std::vector<Vec3> normals(points.size(), Vec3::Zero());
  for (auto p = points.begin(); p != unoriented; ++p)
    normals[p->index] = Vec3(p->normal.x(), p->normal.y(), p->normal.z()).normalized();
  phases.end();
  return normals;
}

}  // namespace palpate::baselines
