// The registry of neighbour builders by name, for renderers, studies and tables.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/options.h>
#include <palpate/result.h>
#include "toolkit/search/neighbour_table.h"

namespace palpate::search {

/// A table with remarks, one sentence each.
struct NeighbourBuild {
  NeighbourTable table;
  std::vector<std::string> notes;
};

struct NeighbourBuilder {
  std::string name;
  std::string summary;  ///< one line
  std::string source;   ///< thesis section
  std::vector<OptionSpec> options;
  /// Needs a non-empty cloud and options completed by validate(). Independent of the number of threads (0 =
  /// all). An Error if the cloud lacks what the builder reads.
  std::function<Result<NeighbourBuild>(const cloud::Cloud&, const Options&, int threads)> build;
  /// Follows the scanner instead of searching: needs a scan's order; links are mutual.
  bool follows_scanner = false;
  bool one_thread = false;  ///< always single-threaded
};

/// All builders: those here in the order of section 3.2.2, then those added. A copy; thread-safe.
[[nodiscard]] std::vector<NeighbourBuilder> neighbour_builders();

/// Adds another module's builder, replacing one of the same name. Call before threads use
/// neighbour_builders().
void add_neighbour_builder(NeighbourBuilder builder);

/// Builds by name ("directional-knn"), with options if wanted ("fixed-distance:distance_mm=0.3"). Errors for
/// unknown names and options list the known ones.
[[nodiscard]] Result<NeighbourBuild> build_neighbours(std::string_view name_and_options,
                                                      const cloud::Cloud& cloud, int threads);
[[nodiscard]] Result<NeighbourBuild> build_neighbours(const NamedOptions& wanted, const cloud::Cloud& cloud,
                                                      int threads);

}  // namespace palpate::search
