#include "device/arms/arm_description.h"

#include <algorithm>
#include <charconv>
#include <limits>
#include <system_error>

#include "toolkit/core/bytes.h"

namespace palpate::device {
namespace {

constexpr std::uint16_t kCalibrationButton = 1;  // bit of info
constexpr std::uint16_t kSetCounts = 1;          // value of command
constexpr std::int32_t kMaxCounts = 10'000'000;
// Shorter commands wait in the board's buffer.
constexpr std::size_t kTextCommandBytes = 16;

std::uint16_t word_at(std::span<const std::uint8_t> bytes, std::size_t word) noexcept {
  return ByteReader(bytes.subspan(2 * word)).u16();
}

void put_word(CommandBytes& command, std::size_t word, std::uint16_t value) noexcept {
  ByteWriter(std::span(command.bytes).subspan(2 * word)).u16(value);
}

/// A zero report of the padded length, at least that of the form.
CommandBytes blank_report(ArmForm form, std::size_t padded) noexcept {
  CommandBytes command;
  command.size = std::clamp(padded, report_size(form), CommandBytes::kMost);
  return command;
}

bool is_blank(std::uint8_t byte) noexcept {
  return byte == ' ' || byte == '\t';
}

}  // namespace

std::optional<ArmReport> decoded_report(ArmForm form, std::size_t padded,
                                        std::span<const std::uint8_t> bytes) noexcept {
  const std::size_t size = report_size(form);
  if (size == 0 || bytes.size() != std::max(padded, size)) return std::nullopt;
  const std::size_t encoders = form == ArmForm::kReport8 ? 3 : 6;
  ArmReport report;
  for (std::size_t i = 0; i < encoders; ++i) report.counts[i] = static_cast<std::int16_t>(word_at(bytes, i));
  if (form == ArmForm::kReport8)
    report.counter = word_at(bytes, 3);
  else
    report.calibrate = word_at(bytes, 6) == kCalibrationButton;
  return report;
}

std::optional<ArmReport> decoded_line(std::span<const std::uint8_t> line) noexcept {
  const char* at = reinterpret_cast<const char*>(line.data());
  const char* end = at + line.size();
  const auto blank = [](const char c) { return is_blank(static_cast<std::uint8_t>(c)); };
  while (at != end && blank(end[-1])) --end;
  while (at != end && blank(*at)) ++at;
  if (end - at < 2 || *at != '[' || end[-1] != ']') return std::nullopt;
  ++at;
  --end;
  std::array<std::int32_t, 8> numbers{};
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    while (at != end && blank(*at)) ++at;
    const auto [next, wrong] = std::from_chars(at, end, numbers[i]);
    if (wrong != std::errc{} || numbers[i] > kMaxCounts || numbers[i] < -kMaxCounts) return std::nullopt;
    at = next;
    while (at != end && blank(*at)) ++at;
    const bool last = i + 1 == numbers.size();
    if (last != (at == end) || (!last && *at++ != ',')) return std::nullopt;
  }
  ArmReport report;
  report.model = numbers.front();
  report.error = numbers.back();
  std::copy(numbers.begin() + 1, numbers.end() - 1, report.counts.begin());
  return report;
}

void ArmLineReader::malformed() noexcept {
  if (malformed_in_a_row_ < std::numeric_limits<std::uint32_t>::max()) ++malformed_in_a_row_;
}

std::optional<ArmReport> ArmLineReader::take(std::uint8_t byte) noexcept {
  if (byte == '\r') return std::nullopt;
  if (byte != '\n') {
    if (size_ == kMaxLine) {  // an endless line is discarded each time the buffer is full
      too_long_ = true;
      size_ = 0;
      malformed();
    }
    held_[size_++] = byte;
    return std::nullopt;
  }
  const std::span<const std::uint8_t> line(held_.data(), size_);
  const bool empty = size_ == 0 && !too_long_;
  const std::optional<ArmReport> report = too_long_ ? std::nullopt : decoded_line(line);
  if (report) {
    last_ = held_;
    last_size_ = size_;
    malformed_in_a_row_ = 0;
  } else if (!empty && !too_long_) {
    malformed();
  }
  size_ = 0;
  too_long_ = false;
  return report;
}

CommandBytes encoded_currents(ArmForm form, std::size_t padded, const Milliamps& currents) noexcept {
  if (form != ArmForm::kText) {
    CommandBytes command = blank_report(form, padded);
    for (std::size_t i = 0; i < currents.size(); ++i)
      put_word(command, i, static_cast<std::uint16_t>(currents[i]));
    return command;
  }
  CommandBytes command;
  char* const begin = reinterpret_cast<char*>(command.bytes.data());
  char* at = begin;
  char* const end = begin + command.bytes.size();  // 3 * 6 characters and 5 more fit
  for (std::size_t i = 0; i < currents.size(); ++i) {
    *at++ = i == 0 ? '[' : ',';
    at = std::to_chars(at, end, currents[i]).ptr;
  }
  *at++ = ']';
  while (static_cast<std::size_t>(at - begin) < kTextCommandBytes - 1) *at++ = ' ';
  *at++ = '\n';
  command.size = static_cast<std::size_t>(at - begin);
  return command;
}

CommandBytes encoded_zero(ArmForm form, std::size_t padded) noexcept {
  CommandBytes zero = encoded_currents(form, padded, {});
  static_assert(2 * kTextCommandBytes <= CommandBytes::kMost);
  if (form == ArmForm::kText) {
    std::copy_n(zero.bytes.begin(), zero.size, zero.bytes.begin() + static_cast<std::ptrdiff_t>(zero.size));
    zero.size *= 2;
  }
  return zero;
}

CommandBytes encoded_counts(std::size_t padded, const std::array<std::int16_t, 6>& counts) noexcept {
  CommandBytes command = blank_report(ArmForm::kReport14, padded);
  for (std::size_t i = 0; i < 3; ++i) {
    put_word(command, i, static_cast<std::uint16_t>(counts[i + 3]));
    put_word(command, i + 4, static_cast<std::uint16_t>(counts[i]));
  }
  put_word(command, 3, kSetCounts);
  return command;
}

}  // namespace palpate::device
