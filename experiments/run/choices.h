// Defaults for a user who names a model alone: renderers to compare, a path, a folder.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <palpate/paths.h>
#include <palpate/registry.h>
#include <palpate/renderer.h>
#include "experiments/run/arguments.h"

namespace palpate::experiments {

/// As deep and as fast as the model's size asks for: what a hand does on its points, or an exploration of
/// them where nothing is there to be felt; on a formula a Lissajous curve with many entries, for an
/// exploration also leaves the part of it that was sampled, where a formula goes on and the points do not. A
/// path generator with its options.
inline constexpr int kUsualFrames = 20'000;  ///< twenty seconds
[[nodiscard]] std::string usual_path(const paths::PathTarget& target, int frames = kUsualFrames);

/// Warning about a model's size for a hand, a whole sentence with a remedy; empty where it fits.
[[nodiscard]] std::string size_hint(const geometry::Aabb& box_mm);

/// Of the points without faces so many are meshed: a quarter of a minute at the 46 µs a point that advancing
/// front takes, a minute on the raw layers of several scans (docs/how-to/prepare-a-scan.md).
/// Larger models are thinned for the mesh.
inline constexpr double kMostPointsMeshed = 300'000;

struct Chosen {
  std::vector<RendererRequest> renderers;
  std::vector<std::string> notes;  ///< whole sentences
};
/// The scene's own renderer, or the plan's choice; `cloud`; and a god object on the best mesh that is made in
/// reasonable time: the models' own faces, else the scanner's rows connected, else a reconstruction. Those
/// that lack what the scene asks for are left out, and a note says so.
[[nodiscard]] Chosen usual_renderers(const render::SceneInput& scene,
                                     const std::optional<RendererRequest>& own,
                                     const render::Registry& registry);

/// "out/COMMAND-NAME", by the model's name; with -2, -3, .. where that holds something else than results of
/// the same scene.
[[nodiscard]] std::string usual_folder(const std::string& command, const std::string& scene);

}  // namespace palpate::experiments
