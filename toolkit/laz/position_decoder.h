// Positions as LAZ codes them, in both compressors: x and y as steps from the last point, predicted by
// running medians of steps to returns of the same kind; z from the last height at the same level below the
// pulse's last return. Also the tables that say which kind and level a return is.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "toolkit/laz/arithmetic_decoder.h"
#include "toolkit/laz/number_decoder.h"

namespace palpate::laz {

/// Kinds of returns where a pulse has up to 7, and up to 15.
inline constexpr std::size_t kReturnKindsOf8 = 16, kReturnKindsOf16 = 6;
/// The kind of return `number` of a pulse with `count`, each as it stands in the file: below 8, or below 16.
[[nodiscard]] std::size_t return_kind_of_8(std::uint32_t count, std::uint32_t number) noexcept;
[[nodiscard]] std::size_t return_kind_of_16(std::uint32_t count, std::uint32_t number) noexcept;
/// How many returns of the pulse follow; numbers that make no sense have a level too.
inline constexpr std::size_t kReturnLevels = 8;
[[nodiscard]] std::size_t return_level(std::uint32_t count, std::uint32_t number) noexcept;

struct GridPosition {
  std::int32_t x = 0, y = 0, z = 0;  ///< in the file's own steps, before scale and offset
};

class PositionDecoder {
 public:
  /// Steps are told apart by `kinds`; `height` stands for heights that have not come yet.
  PositionDecoder(std::size_t kinds, std::int32_t height);

  /// Moves `position` to the next point. `single`: its pulse has one return. `heights` null: they do not
  /// change.
  void next(ArithmeticDecoder& steps, ArithmeticDecoder* heights, std::size_t kind, std::size_t level,
            bool single, GridPosition& position);

 private:
  std::vector<RunningMedian> x_medians_, y_medians_;
  std::array<std::int32_t, kReturnLevels> height_at_;
  NumberDecoder x_steps_, y_steps_, heights_;
};

}  // namespace palpate::laz
