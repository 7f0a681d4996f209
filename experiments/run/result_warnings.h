// Warnings about models, references and paths together. Each may be fine alone; combinations are refused
// where nothing sensible can come of them, else warned of in whole sentences.
#pragma once

#include <string>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/scene.h>
#include "experiments/run/run.h"
#include "experiments/run/stage.h"

namespace palpate::experiments {

/// An Error for a model whose points are no surface.
[[nodiscard]] Status check_surfaces(const scene::LoadedScene& scene);

/// Warnings about a prepared file: damaged tiles, and frames that the finest surface did not answer.
[[nodiscard]] std::vector<std::string> warnings_about_tiles(const render::FrameCounters& counted);

/// Models far apart, or of sizes that no scene has.
[[nodiscard]] std::vector<std::string> warnings_about_models(const scene::LoadedScene& scene);

/// An Error where the truth, a mesh in the model's frame, stands elsewhere than the model; what is doubtful
/// about its size or distance.
[[nodiscard]] Result<std::vector<std::string>> warnings_about_reference(const geometry::TriangleMesh& truth,
                                                                        const render::ModelInput& model,
                                                                        const std::string& file);

/// A truth from another file that the points do not lie on.
[[nodiscard]] std::vector<std::string> warnings_about_alignment(const Stage& stage);

/// Remarks on renderers that stand on the same faces as the truth; no warning.
[[nodiscard]] std::vector<std::string> remarks_on_reference(const StagedStudy& study);

/// A path that never touches, with its nearest approach; renderers that feel nothing where others do.
[[nodiscard]] std::vector<std::string> warnings_about_contact(const StagedStudy& study);

// Where renderers answer otherwise than each other along a path: what can be said where there is no truth.

/// Stretches of 20 ms and more in which a god object is farther from the others than 1 mm and two spacings, a
/// free one standing where the HIP is: the longest few, where, for how long, and who stands alone, in whole
/// sentences. Empty where there is a truth, or fewer than two traces.
[[nodiscard]] std::vector<std::string> disagreements(const StagedStudy& study);

}  // namespace palpate::experiments
