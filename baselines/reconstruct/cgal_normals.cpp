// Normals by CGAL, in a separate file because its point set processing compiles slowly.
#include "baselines/reconstruct/cgal_points.h"
#include "baselines/reconstruct/method_functions.h"

#include <CGAL/Random.h>
#include <CGAL/jet_estimate_normals.h>
#include <CGAL/mst_orient_normals.h>
#include <CGAL/pca_estimate_normals.h>

namespace palpate::baselines {
void seed_cgal() {
  CGAL::get_default_random() = CGAL::Random(0);
}

std::vector<Vec3> cgal_normals(const MethodInput& input, bool jets, unsigned k,
                               render::PreparePhases& phases) {
  phases.begin(kNormalsPhase);
  std::vector<CgalPoint> points = cgal_points(input.cloud, input.spacing);
  const auto parameters = CGAL::parameters::point_map(CgalPlaceMap()).normal_map(CgalNormalMap());
  with_cgal_threads(input.threads, [&](auto tag) {
    if (jets)
      CGAL::jet_estimate_normals<decltype(tag)>(points, k, parameters);
    else
      CGAL::pca_estimate_normals<decltype(tag)>(points, k, parameters);
  });
  phases.end();
  phases.begin(kOrientationPhase);
  const auto unoriented = CGAL::mst_orient_normals(points, k, parameters);
  std::vector<Vec3> normals(points.size(), Vec3::Zero());
  for (auto p = points.begin(); p != unoriented; ++p)
    normals[p->index] = Vec3(p->normal.x(), p->normal.y(), p->normal.z()).normalized();
  phases.end();
  return normals;
}

}  // namespace palpate::baselines
