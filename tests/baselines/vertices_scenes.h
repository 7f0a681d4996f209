// The scenes of the toolkit's tests under `cloud-vertices`.
#pragma once

#include <string>

#include "baselines/rivals.h"
#include "tests/toolkit/renderers/scenes.h"

namespace palpate::baselines::vertices {

using namespace render;

inline test::Stepped ready(const SceneInput& scene, const std::string& spec) {
  Registry registry;
  register_toolkit_renderers(registry);
  registry.add(cloud_vertices_info());
  const NamedOptions named = parse_named_options(spec).value();
  auto renderer = registry.make(named.name, named.options).value();
  const auto report = renderer->prepare(scene, {1, nullptr});
  EXPECT_TRUE(report) << (report ? "" : report.error().message());
  return renderer;
}

}  // namespace palpate::baselines::vertices
