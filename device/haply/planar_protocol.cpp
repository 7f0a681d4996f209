#include "device/haply/planar_protocol.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <span>

namespace palpate::device {
namespace {

constexpr std::uint8_t kSetUp = 1, kTorques = 2;
constexpr std::uint8_t kAddress = 5;    // of the 2DIY
constexpr std::uint8_t kBothPorts = 3;  // a bit each
// Cranks turn less than once from where they are set up.
constexpr float kMostDeg = 720.0F;

constexpr PlanarModel kSecond{
    "2DIY, generation 2", {70.0, 90.0, 0.0}, {241.0F, -61.0F}, 10752.0F, {0, 1}, {0, 1}};
constexpr PlanarModel kThird{
    "2DIY, generation 3", {70.0, 90.0, 38.0}, {168.0F, 12.0F}, 4880.0F, {1, 1}, {1, 1}};

void add_float(CommandBytes& command, float value) noexcept {
  const auto bits = std::bit_cast<std::uint32_t>(value);
  for (unsigned shift = 0; shift < 32; shift += 8)
    command.bytes[command.size++] = static_cast<std::uint8_t>((bits >> shift) & 0xFFU);
}

float float_at(std::span<const std::uint8_t> bytes, std::size_t at) noexcept {
  std::uint32_t bits = 0;
  for (std::size_t i = 0; i < 4; ++i) bits |= static_cast<std::uint32_t>(bytes[at + i]) << (8 * i);
  return std::bit_cast<float>(bits);
}

bool can_be(float degrees) noexcept {
  return std::isfinite(degrees) && std::abs(degrees) <= kMostDeg;
}

}  // namespace

const PlanarModel* planar_model(int generation) noexcept {
  return generation == 2 ? &kSecond : generation == 3 ? &kThird : nullptr;
}

CommandBytes encoded_set_up(const PlanarModel& model) noexcept {
  CommandBytes command;
  for (const std::uint8_t byte :
       {kSetUp, kAddress, kBothPorts, model.motor_counter[0], model.motor_counter[1], kBothPorts,
        model.encoder_counter[0], model.encoder_counter[1], std::uint8_t{0}, std::uint8_t{0}})
    command.bytes[command.size++] = byte;
  for (const float rest : {model.rest_deg[1], model.rest_deg[0]}) {
    add_float(command, rest);
    add_float(command, model.counts_per_turn);
  }
  return command;
}

CommandBytes encoded_torques(const std::array<float, 2>& torques_n_m) noexcept {
  CommandBytes command;
  command.bytes[command.size++] = kTorques;
  command.bytes[command.size++] = kAddress;
  add_float(command, torques_n_m[1]);
  add_float(command, torques_n_m[0]);
  return command;
}

CommandBytes encoded_let_go() noexcept {
  const CommandBytes zero = encoded_torques({});
  CommandBytes all;
  while (all.size + 1 + zero.size <= CommandBytes::kMost) {
    if (all.size > 0) all.bytes[all.size++] = 0;
    std::copy_n(zero.bytes.begin(), zero.size, all.bytes.begin() + static_cast<std::ptrdiff_t>(all.size));
    all.size += zero.size;
  }
  return all;
}

void PlanarReader::malformed() noexcept {
  if (malformed_in_a_row_ < std::numeric_limits<std::uint32_t>::max()) ++malformed_in_a_row_;
}

void PlanarReader::begin() noexcept {
  if (size_ != 0) malformed();
  size_ = 0;
}

void PlanarReader::drop_to_next_address() noexcept {
  const auto end = held_.begin() + static_cast<std::ptrdiff_t>(size_);
  const auto next = std::find(held_.begin() + 1, end, kAddress);
  size_ = static_cast<std::size_t>(std::copy(next, end, held_.begin()) - held_.begin());
}

std::optional<std::array<float, 2>> PlanarReader::take(std::uint8_t byte) noexcept {
  if (size_ == 0 && byte != kAddress) return std::nullopt;
  held_[size_++] = byte;
  if (size_ < kPlanarReplyBytes) return std::nullopt;
  const float second = float_at(held_, 1), first = float_at(held_, 5);
  if (!can_be(first) || !can_be(second)) {
    malformed();
    drop_to_next_address();
    return std::nullopt;
  }
  last_ = held_;
  size_ = 0;
  malformed_in_a_row_ = 0;
  return std::array<float, 2>{first, second};
}

}  // namespace palpate::device
