// Registers the baseline renderers and cleaning steps. Lists the libraries that they stand on.
//
// First:
//   palpate::render::Registry registry;
//   palpate::render::register_toolkit_renderers(registry);
//   palpate::baselines::register_baseline_renderers(registry);
//   auto rival = registry.make("mesh-godobject", {});
#pragma once

#include <string>
#include <utility>
#include <vector>

#include <palpate/registry.h>

namespace palpate::scene {
class Cleaning;  // scene.h
}

namespace palpate::baselines {

/// Adds all rivals on meshes and on points.
void register_baseline_renderers(render::Registry& registry);

/// Cleaning steps for raw scans, by CGAL: outliers, smooth, thin, upsample, fill-holes.
/// Adds every step. Lengths are in spacings (square root of the occupied area per point), so results scale
/// with the cloud. CGAL uses one thread: the result does not depend on `threads`.
void register_cleaning(scene::Cleaning& cleaning);

/// Name and version of every library that does a rival's work, as this program found them when it was
/// compiled: the times of rivals are theirs as well.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> library_versions();

}  // namespace palpate::baselines
