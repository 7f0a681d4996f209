// The stress matrix as table, picture, document and page.
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

/// Known reason for a renderer's failure in a case, as a sentence; else empty.
[[nodiscard]] std::string known_reason(const RendererRequest& request, const StressCase& one,
                                       const StressCell& cell);
/// The renderer's command-line text without its label: "cloud:refine=1".
[[nodiscard]] std::string spelled(const RendererRequest& request);

/// Number of failed cells of this role.
[[nodiscard]] std::size_t failures(const StressMatrix& matrix, render::Role role);

/// Cases as rows, renderers as columns.
[[nodiscard]] Table stress_table(const StressMatrix& matrix);
/// Counts of each renderer's cells by status.
[[nodiscard]] Table stress_summary(const StressMatrix& matrix);
/// A square per cell, as SVG.
[[nodiscard]] std::string stress_picture(const StressMatrix& matrix);
[[nodiscard]] std::string stress_json(const StressMatrix& matrix);
[[nodiscard]] Page stress_page(const StressMatrix& matrix);

}  // namespace palpate::experiments
