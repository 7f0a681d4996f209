#include "baselines/register.h"

#include "baselines/points/mls_penalty.h"
#include "baselines/points/mls_proxy.h"
#include "baselines/points/penalty_grid.h"
#include "baselines/points/sdf_godobject.h"
#include "baselines/points/sphere_proxy.h"
#include "baselines/points/stream_proxy.h"
#include "baselines/points/variable_proxy.h"
#include "baselines/points/vector_field.h"
#include "baselines/points/vgraph.h"
#include "baselines/renderers/mesh_godobject.h"
#include "baselines/renderers/mesh_proxy.h"

namespace palpate::baselines {

void register_baseline_renderers(render::Registry& registry) {
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
