#include "tests/device/mock/falcon_board.h"

#include <algorithm>
#include <cmath>

#include "device/falcon/falcon_device.h"

namespace palpate::device {
namespace {

constexpr std::int64_t kBoardNsPerMs = 1'000'000;
constexpr std::uint16_t kRomBaud = 0x4138, kLoadBaud = 0x0015, kPacketBaud = 0x0002;
constexpr std::size_t kChipHolds = 384;  // bytes: more than that are lost, as the chip loses them

}  // namespace

void FalconBoard::power_cycle() {
  reset();
  resets_ = 0;
  held_ = {};
  homed = 0;
}

void FalconBoard::reset() {
  stage_ = Stage::kRom;
  received_.clear();
  loaded_.clear();
  ++resets_;
}

void FalconBoard::control(const ControlRequest& request, std::int64_t now_ns) {
  if (request.type != 0x40 || request.index != 0) return;
  switch (request.request) {
    case 0x00:
      if (request.value == 1) to_host_.clear();
      break;
    case 0x01:
      if (request.value == 0x0101 && !dtr_) reset();  // the edge
      if (request.value == 0x0101 || request.value == 0x0100) dtr_ = request.value == 0x0101;
      break;
    case 0x03:
      baud_ = request.value;
      break;
    case 0x06:
      event_character_ = request.value == 0x013E;
      break;
    case 0x09:
      latency_ms_ = request.value;
      sent_ns_ = now_ns;
      break;
    default:
      break;
  }
}

void FalconBoard::answer(std::span<const std::uint8_t> bytes) {
  for (const std::uint8_t byte : bytes)
    if (to_host_.size() < kChipHolds) to_host_.push_back(byte);
}

void FalconBoard::out(std::span<const std::uint8_t> bytes, std::int64_t now_ns) {
  for (const std::uint8_t byte : bytes) take(byte, now_ns);
}

void FalconBoard::take(std::uint8_t byte, std::int64_t) {
  switch (stage_) {
    case Stage::kRom: {
      if (baud_ != kRomBaud || faults.mute_rom) return;
      received_.push_back(byte);
      const std::vector<std::uint8_t> hello = {0x0A, 0x43, 0x0D}, reply = {0x0A, 0x44, 0x2C, 0x0D};
      if (received_.size() < 3 || !std::equal(hello.begin(), hello.end(), received_.end() - 3)) return;
      if (faults.zero_first) to_host_.push_back(0);
      answer(reply);
      received_.clear();
      stage_ = Stage::kGreeted;
      return;
    }
    case Stage::kGreeted:
      if (baud_ == kRomBaud) {  // greeted again
        stage_ = Stage::kRom;
        return take(byte, 0);
      }
      if (baud_ != kLoadBaud || dtr_ || byte != 'A') return;
      answer(std::span(&byte, 1));
      stage_ = Stage::kLoading;
      return;
    case Stage::kLoading:
      if (baud_ == kLoadBaud) take_loading(byte);
      return;
    case Stage::kRunning:
      if (baud_ == kPacketBaud && !faults.dead_image) take_packet(byte);
      return;
  }
}

void FalconBoard::take_loading(std::uint8_t byte) {
  loaded_.push_back(byte);
  std::uint8_t echo = byte;
  if (faults.wrong_echoes > 0 && loaded_.size() == faults.wrong_at) {
    echo ^= 1U;
    --faults.wrong_echoes;
  }
  answer(std::span(&echo, 1));
  if (image_is_whole()) stage_ = Stage::kRunning;
}

/// The walk of the boot loader, by itself: at an even place behind the head, a block's length of 0 ends it.
bool FalconBoard::image_is_whole() const {
  std::size_t at = 22;
  while (at + 2 <= loaded_.size()) {
    const std::size_t words = loaded_[at] + 256U * loaded_[at + 1];
    if (words == 0) return true;
    at += 2 + 4 + 2 * words;
  }
  return false;
}

void FalconBoard::take_packet(std::uint8_t byte) {
  if (received_.empty() && byte != '<') {
    ++refused_;
    return;
  }
  received_.push_back(byte);
  if (received_.size() < kFalconPacketBytes) return;
  const auto command = falcon_command(std::span(received_).first<kFalconPacketBytes>());
  received_.clear();
  if (!command) {
    refused_ += kFalconPacketBytes;
    return;
  }
  held_ = *command;
  ++commands_;
  if (commanded) commanded(*this);
  if (faults.deaf_for > 0) {
    --faults.deaf_for;
    return;
  }
  if (faults.silent) return;
  FalconReply reply;
  for (std::size_t leg = 0; leg < counts.size(); ++leg)
    reply.counts[leg] =
        static_cast<std::int16_t>(echo_motors ? command->motors[leg] : counts[leg] + faults.jump[leg]);
  reply.buttons = buttons;
  reply.homed = static_cast<std::uint8_t>(faults.lost_homing ? homed & 5U : homed);
  FalconBytes bytes = encoded(reply);
  if (faults.garbled) bytes[7] = 'z';
  if (!instead) return answer(bytes);
  for (const std::vector<std::uint8_t>& one : instead({bytes.begin(), bytes.end()})) answer(one);
}

bool FalconBoard::due(std::int64_t now_ns) const {
  const bool full = to_host_.size() >= 62;
  const bool event = event_character_ && std::find(to_host_.begin(), to_host_.end(), '>') != to_host_.end();
  return full || event || now_ns - sent_ns_ >= latency_ms_ * kBoardNsPerMs;
}

std::optional<std::vector<std::uint8_t>> FalconBoard::in(std::int64_t now_ns) {
  if (!due(now_ns)) return std::nullopt;
  sent_ns_ = now_ns;
  std::vector<std::uint8_t> packet = {0x01, 0x60};  // what a real chip says of an idle line
  const std::size_t size = std::min(to_host_.size(), most_per_packet);
  for (std::size_t i = 0; i < size; ++i) {
    packet.push_back(to_host_.front());
    to_host_.pop_front();
  }
  return packet;
}

Vec3 falcon_counts_of_angles(const Vec3& angles_rad) {
  const Vec3 at_zero = falcon_angles_of_counts(Vec3::Zero());
  const double rad_per_count = 1e-3 * (falcon_angles_of_counts(Vec3::Constant(1e3)) - at_zero).x();
  return (angles_rad - at_zero) / rad_per_count;
}

std::array<int, 3> falcon_counts_at(const Vec3& device_mm) {
  const Vec3 place = device_mm + Vec3{0.0, 0.0, kFalconCentreMm};
  const Vec3 counts = falcon_counts_of_angles(falcon_angles(place).value());
  std::array<int, 3> rounded{};
  for (int leg = 0; leg < 3; ++leg)
    rounded[static_cast<std::size_t>(leg)] = static_cast<int>(std::lround(counts[leg]));
  return rounded;
}

std::vector<std::uint8_t> made_up_image(std::size_t blocks, std::size_t words) {
  std::vector<std::uint8_t> bytes = {0xAA, 0x08};
  const auto word = [&](std::size_t value) {
    bytes.push_back(static_cast<std::uint8_t>(value & 0xFFU));
    bytes.push_back(static_cast<std::uint8_t>(value >> 8U));
  };
  for (int reserved = 0; reserved < 8; ++reserved) word(0);
  word(0x3F), word(0x8002);  // the entry, upper word first
  for (std::size_t block = 0; block < blocks; ++block) {
    word(words);
    word(0x3F), word(0x8000 + block * words);
    for (std::size_t i = 0; i < words; ++i) word((block * 7919 + i * 31) & 0xFFFF);
  }
  word(0);
  return bytes;
}

}  // namespace palpate::device
