// Truths, scores and comparisons.
#pragma once

#include <memory>
#include <string>

#include "experiments/python/convert.h"
#include "experiments/python/scene_object.h"

namespace palpate::python {

/// A file's path, or one that a generator makes for the scene.
[[nodiscard]] Path made_path(const std::string& text, const ScenePtr& scene);
/// A Path, or an (n, 3) array at this rate.
[[nodiscard]] Path path_of(py::handle given, double rate_hz, const ScenePtr& scene);

void add_comparison(py::module_& module);

}  // namespace palpate::python
