// What open arms say over their links, and what is said to them.
//
//   report8   8 bytes, little-endian int16: encoders a, b, c, counter / currents a, b, c in mA, 0
//   report14  14 bytes: encoders a..f, info (1: calibration button) / mA a, b, c, command, 3 attributes;
//             command 1 sets the encoders: attributes a, b, c, the currents' places d, e, f
//   text      "[model,a,b,c,d,e,f,error]\n" / "[mA,mA,mA]", blanks up to 15, "\n"
//
// Reports may be padded (Teensy: 64 bytes). None has a checksum of its own; USB has one below. report8 comes
// unasked; the others alternate: one report, one command. Source: the makers' published programs (facts).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "device/links/newest_command.h"

namespace palpate::device {

enum class ArmForm : std::uint8_t { kReport8, kReport14, kText };

/// Whether it answers each command with one report, and sends none unasked.
[[nodiscard]] constexpr bool alternates(ArmForm form) noexcept {
  return form != ArmForm::kReport8;
}
/// Bytes of a report without padding; 0 for text.
[[nodiscard]] constexpr std::size_t report_size(ArmForm form) noexcept {
  return form == ArmForm::kReport8 ? 8 : form == ArmForm::kReport14 ? 14 : 0;
}

struct ArmReport {
  std::array<std::int32_t, 6> counts{};  ///< of report8 three
  std::uint16_t counter = 0;             ///< of report8
  bool calibrate = false;                ///< the calibration button, of report14
  std::int32_t model = 0, error = 0;     ///< of text

  friend bool operator==(const ArmReport&, const ArmReport&) = default;
};

/// One report of `bytes.size()` bytes as it came; nothing where it is not `padded` bytes long.
[[nodiscard]] std::optional<ArmReport> decoded_report(ArmForm form, std::size_t padded,
                                                      std::span<const std::uint8_t> bytes) noexcept;

/// Finds lines in a stream that may be torn, glued and damaged. One thread; no allocation.
class ArmLineReader {
 public:
  static constexpr std::size_t kMostLine = 96;  ///< eight numbers of eleven signs, and what is between
  /// A report where `byte` ended the line of one.
  [[nodiscard]] std::optional<ArmReport> take(std::uint8_t byte) noexcept;
  /// The line that take() gave last, without its end.
  [[nodiscard]] std::span<const std::uint8_t> line() const noexcept { return {last_.data(), last_size_}; }
  /// Lines that were none, since the last that was one.
  [[nodiscard]] std::uint32_t malformed_in_a_row() const noexcept { return malformed_in_a_row_; }
  void clear() noexcept { *this = {}; }

 private:
  void malformed() noexcept;

  std::array<std::uint8_t, kMostLine> held_{}, last_{};
  std::size_t size_ = 0, last_size_ = 0;
  bool too_long_ = false;
  std::uint32_t malformed_in_a_row_ = 0;
};
/// A line without its end. Exactly eight whole numbers; none beyond 10 million, which no encoder reaches.
[[nodiscard]] std::optional<ArmReport> decoded_line(std::span<const std::uint8_t> line) noexcept;

using Milliamps = std::array<std::int16_t, 3>;

/// The command for these currents; `padded` as for reports.
[[nodiscard]] CommandBytes encoded_currents(ArmForm form, std::size_t padded,
                                            const Milliamps& currents) noexcept;
/// Zero, for who does not know what was sent last: of text twice, for a board that got half a line before
/// takes the first for the rest of it.
[[nodiscard]] CommandBytes encoded_zero(ArmForm form, std::size_t padded) noexcept;
/// The command that makes the arm's counters show these; of report14 alone.
[[nodiscard]] CommandBytes encoded_counts(std::size_t padded,
                                          const std::array<std::int16_t, 6>& counts) noexcept;

}  // namespace palpate::device
