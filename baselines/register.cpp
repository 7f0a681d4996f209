#include <palpate/baselines.h>

#include "baselines/points/rivals.h"
#include "baselines/renderers/mesh_godobject.h"

namespace palpate::baselines {

void register_baseline_renderers(render::Registry& registry) {
  registry.add(cloud_vertices_info());
  registry.add(mesh_godobject_info());
  registry.add(penalty_grid_info());
  registry.add(sphere_proxy_info());
  registry.add(mesh_proxy_info());
  registry.add(stream_proxy_info());
  registry.add(mls_penalty_info());
  registry.add(mls_proxy_info());
  registry.add(vgraph_info());
  registry.add(vector_field_info());
  registry.add(sdf_godobject_info());
  registry.add(variable_proxy_info());
}

}  // namespace palpate::baselines
