// Which settings nobody should take: another one is as good in everything and better in something.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "experiments/trade/row.h"

namespace palpate::experiments {

/// What is weighed against the error.
enum class Cost { kSpeed, kMemory, kPreparation };
inline constexpr std::array<Cost, 3> kCosts = {Cost::kSpeed, Cost::kMemory, Cost::kPreparation};
/// "speed", "memory", "preparation".
[[nodiscard]] const char* name_of(Cost cost) noexcept;
/// The number that stands for it; nothing where it cannot be compared (a mesh from a cache).
[[nodiscard]] std::optional<Measured> cost_of(const Row& row, Cost cost);

/// Beyond the interval of both, and beyond `slack` more (0.1: a tenth).
[[nodiscard]] bool surely_less(const Measured& a, const Measured& b, double slack = 0.0) noexcept;

struct Standing {
  bool dominated = false;
  std::string by;               ///< one that dominates it, or one that does; not dominated itself
  std::vector<Cost> on_fronts;  ///< where nothing beats it in this cost and in error
};

/// One for each row; rows that are not ok have none of it. Of two rows of one machine, a dominates b where
/// a is surely worse in none of load, longest frames (p99.9), memory, preparation and error, surely better in
/// one, and better on the whole (the product of the ratios): the last keeps a and b from each dominating the
/// other by way of a third. An error may not be worse by more than kSameError either, sure or not: the frames
/// are the same, and an interval over few episodes would let a cheap setting beat any other. "Surely" is
/// beyond both intervals; of times also beyond what their anchors differ
/// by, of preparations that were made once also beyond kOncePrepared. Rows of different machines say nothing
/// of each other. O(n^2).
[[nodiscard]] std::vector<Standing> standings_of(const std::vector<Row>& rows);

/// Errors over the same frames that differ by less are alike. A choice, not a measurement.
inline constexpr double kSameError = 0.05;

/// How far a single preparation may be from the median of several. A choice, not a measurement: on a busy
/// machine three preparations of a small model were seen to differ by more.
inline constexpr double kOncePrepared = 0.2;

}  // namespace palpate::experiments
