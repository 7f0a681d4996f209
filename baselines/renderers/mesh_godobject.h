// The renderers `mesh-godobject` and `mesh-proxy`.
#pragma once

#include <memory>
#include <string>

#include <palpate/registry.h>

namespace palpate::baselines {

/// What all mesh renderers say of themselves.
[[nodiscard]] render::RendererInfo mesh_renderer_info(std::string name, std::string summary,
                                                      std::string source);

/// Zilles and Salisbury (1995) on a triangle mesh: god object in facet_walk.h, entries in segment_index.h,
/// contact in mesh_probe.h. make() gives a MeshHolder.
[[nodiscard]] render::RendererInfo mesh_godobject_info();

/// The same under another name, as a sphere of size zero. `options`: mesh_renderer_specs(); others are kept
/// for describe().
[[nodiscard]] std::unique_ptr<render::HapticRenderer> make_point_on_mesh(std::string name,
                                                                         std::string summary,
                                                                         std::string source,
                                                                         const Options& options);

/// Ruspini's sphere proxy (1997) on a triangle mesh, with facets from Embree; see sphere_probe.h. One sphere
/// for the whole scene. make() gives a MeshHolder.
[[nodiscard]] render::RendererInfo mesh_proxy_info();

}  // namespace palpate::baselines
