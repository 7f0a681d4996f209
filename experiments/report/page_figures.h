// Figures in README.md and docs/: each stands in a marked block, which is written from a template and from
// results, never by hand.
//
//   <!-- figures: NAME -->
//   what docs/figures/NAME.txt says, its {..} filled from the results that its first line names
//   <!-- end of figures -->
//
// Results are docs/figures/FILE.json: {"commit", "date", "machine", "documents": {"table7/result.json": ..}},
// documents as a run wrote them, reduced to what is shown; a text is shown as it stands. {table7 cloud
// frame.mean_us µs} is a key of a renderer, with its unit ("s" of a key in ms, "µs", "%", none, or "by:37.4",
// how often it is in that); {table6/neighbours.json modified_knn[dragon].points} one of any document;
// {commit} says where all of it comes from.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <palpate/result.h>

namespace palpate::experiments {

struct PageWithFigures {
  std::filesystem::path file;
  std::string before, after;  ///< its text, and with every block written anew
  std::size_t blocks = 0;
};

/// README.md and the pages below docs/ that have such blocks. An Error names the file and line of a block, a
/// template or a value that is not there.
[[nodiscard]] Result<std::vector<PageWithFigures>> pages_with_figures(const std::filesystem::path& checkout);

/// Writes those that differ; answers their names.
[[nodiscard]] Result<std::vector<std::string>> write_page_figures(const std::filesystem::path& checkout);

/// Puts the results of `run`, a folder that `palpate reproduce` has written, in place of what stands in
/// docs/figures/`file`: every value that a template shows of it.
[[nodiscard]] Status take_page_figures(const std::filesystem::path& checkout, const std::string& file,
                                       const std::filesystem::path& run);

}  // namespace palpate::experiments
