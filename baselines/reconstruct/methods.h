// All reconstruction methods with sources and options.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <palpate/options.h>
#include <palpate/result.h>

namespace palpate::baselines {

struct Method {
  std::string name;
  std::string summary;  ///< one line
  std::string source;   ///< paper and library
  /// Keys are unique over all methods, or mean the same. Lengths are in spacings (the root of the occupied
  /// area per point), so the mesh scales with the cloud.
  std::vector<OptionSpec> options;
  int version = 1;  ///< increased when the same points would give another mesh; part of the cache key
  bool raster_only = false;  ///< needs a cloud in a scanner's full raster
  std::string not_built{};   ///< why this build lacks it; empty if present
};

/// advancing-front, poisson, scale-space, alpha-shape, power-crust, ball-pivoting, greedy-projection,
/// marching-cubes, organised, stars.
[[nodiscard]] const std::vector<Method>& methods();
/// Finds a method by name. The Error names all methods, or says how to get one that this build lacks.
[[nodiscard]] Result<const Method*> find_method(std::string_view name);
/// Options of all methods, each key once, conditional on the option `method_key`.
[[nodiscard]] std::vector<OptionSpec> all_method_options(const std::string& method_key);
[[nodiscard]] Options own_options(const Method& method, const Options& options);

}  // namespace palpate::baselines
