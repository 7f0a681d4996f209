// The triangles that `cloud` feels, for every mesh renderer.
#include "baselines/reconstruct/method_functions.h"
#include "toolkit/stars/star_mesh.h"

namespace palpate::baselines {

Result<geometry::TriangleMesh> stars_of_points(const MethodInput& input, render::PreparePhases& phases) {
  phases.begin("stars");
  geometry::TriangleMesh mesh = stars::StarMesh::build(input.cloud, input.threads).as_mesh();
  phases.end();
  return mesh;
}

}  // namespace palpate::baselines
