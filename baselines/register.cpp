#include "baselines/register.h"

#include "baselines/renderers/mesh_godobject.h"

namespace palpate::baselines {

void register_baseline_renderers(render::Registry& registry) {
  registry.add(mesh_godobject_info());
}

}  // namespace palpate::baselines
