#include <palpate/registry.h>

#include "toolkit/renderers/renderer_infos.h"

namespace palpate::render {

void register_toolkit_renderers(Registry& registry) {
  registry.add(cloud_literal_info());
  registry.add(cloud_info());
  registry.add(cloud_smooth_info());
  registry.add(heightfield_literal_info());
  registry.add(heightfield_info());
  registry.add(depth_image_info());
  registry.add(analytic_info());
  registry.add(brute_force_info());
}

}  // namespace palpate::render
