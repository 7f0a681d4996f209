// --stiffness, --friction and --deformation: what the command line says of surfaces.
#pragma once

#include <string>
#include <vector>

#include <palpate/result.h>
#include <palpate/scene.h>

namespace palpate::experiments {

/// As typed; empty: as the scene says.
struct SurfaceArguments {
  std::string stiffness;    ///< N/mm
  std::string friction;     ///< one coefficient, or static,dynamic
  std::string deformation;  ///< 0 up to 1

  [[nodiscard]] bool any() const { return !(stiffness.empty() && friction.empty() && deformation.empty()); }
};

/// What is said of the values that were put in.
struct SurfaceReport {
  std::vector<std::string> notes;     ///< what holds now
  std::vector<std::string> warnings;  ///< where it does not hold
};

/// Puts the values in place of the uniform ones of every model. Values that cannot be, and models whose value
/// comes from a column or an image, are Errors; a region that has its own value keeps it, which is a warning.
[[nodiscard]] Result<SurfaceReport> set_surfaces(const SurfaceArguments& arguments, scene::SceneFile& scene);

}  // namespace palpate::experiments
