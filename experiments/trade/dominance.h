// Dominated settings: another is as good in everything and better in something.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "experiments/trade/row.h"

namespace palpate::experiments {

/// Costs weighed against the error.
enum class Cost { kSpeed, kMemory, kPreparation };
inline constexpr std::array<Cost, 3> kCosts = {Cost::kSpeed, Cost::kMemory, Cost::kPreparation};
/// "speed", "memory", "preparation".
[[nodiscard]] const char* name_of(Cost cost) noexcept;
/// The cost's number; empty if incomparable (a mesh from a cache).
[[nodiscard]] std::optional<Measured> cost_of(const Row& row, Cost cost);

/// True beyond both intervals and beyond `slack` (0.1: a tenth).
[[nodiscard]] bool surely_less(const Measured& a, const Measured& b, double slack = 0.0) noexcept;

struct Standing {
  bool dominated = false;
  std::string by;               ///< an undominated row that dominates it, directly or through others; empty:
                                ///< not dominated
  std::vector<Cost> on_fronts;  ///< fronts of cost and error on which it is undominated
};

/// Standings of all rows; rows that are not ok get none. O(n^2). Row a dominates row b of the same machine if
/// it is surely worse in none of load, longest frames (p99.9), memory, preparation and error, surely better
/// in one, and better on the whole (product of ratios). The last rule prevents two rows from dominating each
/// other by way of a third. The error may also not be worse by more than kSameError, sure or not: the frames
/// are equal, and an interval over few episodes would let a cheap setting win. "Surely" means beyond both
/// intervals; for times also beyond the anchors' difference, for single preparations beyond kOncePrepared.
[[nodiscard]] std::vector<Standing> standings_of(const std::vector<Row>& rows);

/// Errors over the same frames that differ by less count as equal. A choice, not a measurement.
inline constexpr double kSameError = 0.05;

/// Assumed deviation of a single preparation from the median of several. A choice, not a measurement: on a
/// busy machine three preparations of a small model differed by more.
inline constexpr double kOncePrepared = 0.2;

}  // namespace palpate::experiments
