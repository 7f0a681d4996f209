// The stress matrix as a table, a picture, a document and a page.
#pragma once

#include <string>
#include <vector>

#include "experiments/report/page.h"
#include "experiments/stress/cell.h"

namespace palpate::experiments {

inline constexpr const char* kStressSchema = "palpate-stress/1";
inline constexpr const char* kStressFile = "stress.json";

struct StressMatrix {
  metrics::DocumentHead head;
  std::vector<StressCase> cases;
  std::vector<RendererRequest> renderers;
  std::vector<render::Role> roles;             ///< by renderer
  std::vector<std::vector<StressCell>> cells;  ///< by renderer, then case
};

/// Why a renderer fails a check of a case, where that is known: a sentence, else nothing.
[[nodiscard]] std::string known_reason(const RendererRequest& request, const StressCase& one,
                                       const StressCell& cell);
/// As on the command line, but for its label: "cloud:refine=1".
[[nodiscard]] std::string spelled(const RendererRequest& request);

/// Cells of this role that failed.
[[nodiscard]] std::size_t failures(const StressMatrix& matrix, render::Role role);

/// Cases as rows, renderers as columns.
[[nodiscard]] Table stress_table(const StressMatrix& matrix);
/// How many cells of each renderer are what.
[[nodiscard]] Table stress_summary(const StressMatrix& matrix);
/// A square for each cell, as SVG.
[[nodiscard]] std::string stress_picture(const StressMatrix& matrix);
[[nodiscard]] std::string stress_json(const StressMatrix& matrix);
[[nodiscard]] Page stress_page(const StressMatrix& matrix);

}  // namespace palpate::experiments
