// The renderer `mesh-godobject`.
#pragma once

#include <memory>
#include <string>

#include "toolkit/render/registry.h"

namespace palpate::baselines {

/// Zilles and Salisbury (1995) on a triangle mesh; see facet_walk.h for the god object, segment_index.h for
/// entries, mesh_probe.h for contact. What make() gives is a MeshHolder too.
[[nodiscard]] render::RendererInfo mesh_godobject_info();

/// The same under another name: a sphere without size is a point. `options` as of mesh_renderer_specs(),
/// more of them are kept for describe().
[[nodiscard]] std::unique_ptr<render::HapticRenderer> make_point_on_mesh(std::string name,
                                                                         std::string summary,
                                                                         std::string source,
                                                                         const Options& options);

}  // namespace palpate::baselines
