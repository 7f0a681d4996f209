// Every way to find neighbours, by name: what renderers, studies and tables choose from.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/options.h"
#include "toolkit/core/result.h"
#include "toolkit/neighbourhood/neighbour_table.h"

namespace palpate::neighbourhood {

/// A table, and what there is to say about how it came out: a sentence each.
struct Built {
  NeighbourTable table;
  std::vector<std::string> notes;
};

struct Builder {
  std::string name;
  std::string summary;  ///< one line
  std::string source;   ///< the section of the thesis
  std::vector<OptionSpec> options;
  /// Needs a non-empty cloud and options that validate() has completed. The same result for any number of
  /// threads (0 = all). An Error where the cloud does not carry what the builder reads.
  std::function<Result<Built>(const cloud::Cloud&, const Options&, int threads)> build;
  /// Follows the scanner instead of searching: needs a scan's order, and a link has one back.
  bool follows_scanner = false;
  bool one_thread = false;  ///< whatever it is given
};

/// All builders: those of this module in the order of section 3.2.2, then those added. A copy; safe from any
/// thread.
[[nodiscard]] std::vector<Builder> builders();

/// Adds a builder of another module; one of the same name is replaced. Before threads use builders().
void add_builder(Builder builder);

/// Builds by name ("directional-knn") or by name and options ("fixed-distance:distance_mm=0.3"). Unknown
/// names and options are Errors that name what there is.
[[nodiscard]] Result<Built> build_neighbours(std::string_view name_and_options, const cloud::Cloud& cloud,
                                             int threads);
[[nodiscard]] Result<Built> build_neighbours(const NamedOptions& wanted, const cloud::Cloud& cloud,
                                             int threads);

}  // namespace palpate::neighbourhood
