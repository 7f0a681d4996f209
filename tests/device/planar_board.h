// The 2DIY's board as the strictest reading of its protocol has it: a command is what its first byte begins,
// of that length, whatever the bytes are; nothing is given up half way.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <span>
#include <utility>
#include <vector>

namespace palpate::device {

/// What becomes of a byte that begins no command: the protocol does not say.
enum class UnknownByte : std::uint8_t { kPassedOver, kWithItsAddress, kWithAllThatCame };

class PlanarBoard {
 public:
  using Bytes = std::vector<std::uint8_t>;
  explicit PlanarBoard(UnknownByte unknown = UnknownByte::kPassedOver) : unknown_(unknown) {}

  /// What it answers to bytes that came together.
  Bytes take(std::span<const std::uint8_t> bytes) {
    Bytes replies;
    for (const std::uint8_t byte : bytes) {
      if (skips_ > 0) {
        --skips_;
        continue;
      }
      if (held_.empty() && byte != kSetUpByte && byte != kTorqueByte) {
        if (unknown_ == UnknownByte::kWithAllThatCame) break;
        if (unknown_ == UnknownByte::kWithItsAddress) skips_ = 1;
        continue;
      }
      held_.push_back(byte);
      const std::size_t whole = held_.front() == kSetUpByte ? kSetUpBytes : kTorqueBytes;
      if (held_.size() == whole) obey(replies);
    }
    return replies;
  }

  std::array<float, 2> torques{};  ///< of ports 1 and 2, held for ever
  float most = 0.0F;               ///< the largest of all, ever
  int obeyed = 0;                  ///< torque commands

  static constexpr std::size_t kSetUpBytes = 26, kTorqueBytes = 10;

 private:
  static constexpr std::uint8_t kSetUpByte = 1, kTorqueByte = 2, kOwnAddress = 5;

  void obey(Bytes& replies) {
    const Bytes command = std::exchange(held_, {});
    if (command.size() != kTorqueBytes) return;
    std::memcpy(torques.data(), command.data() + 2, sizeof torques);
    for (const float torque : torques) most = std::max(most, std::abs(torque));
    ++obeyed;
    const std::array<float, 2> angles{-20.0F, 200.0F};
    const auto* from = reinterpret_cast<const std::uint8_t*>(angles.data());
    replies.push_back(kOwnAddress);
    replies.insert(replies.end(), from, from + sizeof angles);
  }

  UnknownByte unknown_;
  Bytes held_;
  int skips_ = 0;
};

}  // namespace palpate::device
