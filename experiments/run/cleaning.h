// The cleaning steps of this program, and what they do to a scene for one renderer.
#pragma once

#include <span>

#include <palpate/cleaning.h>

namespace palpate::experiments {

/// Every step that the program was built with; none without the baselines. Lives as long as the program.
[[nodiscard]] const scene::Cleaning& all_cleaning();

/// "outliers/distance=4/..+smooth/..": what parse() reads, every option in it.
[[nodiscard]] std::string cleaning_text(std::span<const NamedOptions> steps);

struct CleanedScene {
  render::SceneInput input;
  std::vector<render::PreparePhase> phases;
  std::vector<std::string> notes;
};

/// `input` with every model's points cleaned by `steps`, and without the faces that belonged to the points
/// before. Checked steps; an Error names the model.
[[nodiscard]] Result<CleanedScene> clean_scene(const render::SceneInput& input,
                                               std::span<const NamedOptions> steps, int threads,
                                               Progress& progress);

}  // namespace palpate::experiments
