// Every way to make a mesh from the points: what there is, where it comes from, what it understands.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "toolkit/core/options.h"
#include "toolkit/core/result.h"

namespace palpate::baselines {

struct Method {
  std::string name;
  std::string summary;  ///< one line
  std::string source;   ///< paper and library
  /// Keys are unique over all methods, or mean the same in each that has them. Lengths are in spacings (the
  /// root of the occupied area per point), so that scaling a cloud scales its mesh.
  std::vector<OptionSpec> options;
  int version = 1;  ///< raised whenever the same points would give another mesh: a part of the cache's key
  bool raster_only = false;  ///< takes only clouds that stand in the full raster of a scanner
  std::string not_built{};   ///< empty, or why this build does not have it
};

/// advancing-front, poisson, scale-space, alpha-shape, power-crust, ball-pivoting, greedy-projection,
/// marching-cubes, organised, stars.
[[nodiscard]] const std::vector<Method>& methods();
/// The method of this name; an Error that names all where there is none, or says how to get it where this
/// build does not have it.
[[nodiscard]] Result<const Method*> find_method(std::string_view name);
/// The options of all methods, each key once, each only with the methods that have it as the value of the
/// option `method_key`.
[[nodiscard]] std::vector<OptionSpec> all_method_options(const std::string& method_key);
/// Those of `options` that `method` has.
[[nodiscard]] Options own_options(const Method& method, const Options& options);

}  // namespace palpate::baselines
