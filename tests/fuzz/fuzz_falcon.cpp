// Fuzzes Falcon firmware images, replies and a whole device: results must match the bytes, and the device
// must stay sane.
#include <algorithm>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <palpate/device/force_governor.h>
#include "device/falcon/falcon_device.h"
#include "tests/fuzz/must.h"

namespace palpate::device {
namespace {

/// Answers until packets flow; then gives the input as packets, whose sizes are bytes of it.
class FuzzedLink final : public ControlLink {
 public:
  explicit FuzzedLink(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  Status open() override { return Done{}; }
  void close() noexcept override {}
  Status control(const ControlRequest&) override { return Done{}; }
  bool submit(std::span<const std::uint8_t> bytes) noexcept override {
    must(bytes.size() == kFalconPacketBytes);
    const auto command = falcon_command(bytes.first<kFalconPacketBytes>());
    must(command.has_value() && (command->flags & FalconCommand::kHoming) != 0);
    pushes = command->motors != std::array<int, 3>{};
    ++asked_;
    return true;
  }
  Polled poll(std::span<std::uint8_t> into) noexcept override {
    if (!booted) {
      if (asked_ == 0) return {};
      asked_ = 0;
      const FalconBytes reply = encoded(FalconReply{});
      std::fill_n(into.begin(), kFtdiStatusBytes, std::uint8_t{1});
      std::copy(reply.begin(), reply.end(), into.begin() + kFtdiStatusBytes);
      return {kFtdiStatusBytes + reply.size(), false};
    }
    if (at_ == bytes_.size()) return {0, true};
    const std::size_t most = std::min(into.size(), bytes_.size() - at_);
    const std::size_t size = std::min<std::size_t>(most, 1U + bytes_[at_] % 64U);
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(at_), size, into.begin());
    at_ += size;
    return {size, false};
  }
  bool booted = false, pushes = false;

 private:
  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
  int asked_ = 0;
};

std::vector<FalconReply> replies_in(std::span<const std::uint8_t> bytes) {
  std::vector<FalconReply> all;
  for (std::size_t i = 0; i + kFalconPacketBytes <= bytes.size();) {
    const auto reply = falcon_reply(bytes.subspan(i).first<kFalconPacketBytes>());
    if (reply) all.push_back(*reply);
    i += reply ? kFalconPacketBytes : 1;
  }
  return all;
}

void read_as_replies(std::span<const std::uint8_t> bytes) {
  FalconReader reader;
  std::vector<FalconReply> found;
  for (const std::uint8_t byte : bytes) {
    const auto reply = reader.take(byte);
    if (!reply) continue;
    must(falcon_reply(reader.bytes()) == *reply && reader.malformed_in_a_row() == 0);
    found.push_back(*reply);
  }
  must(found == replies_in(bytes));
  must(bytes.size() - kFalconPacketBytes * found.size() - reader.dropped() < kFalconPacketBytes);
}

void read_as_image(std::span<const std::uint8_t> bytes) {
  const auto image = check_falcon_firmware({bytes.begin(), bytes.end()});
  // Head, six bytes before each block, two a word, two at the end.
  if (image) must(bytes.size() == 22 + 6 * image->blocks + 2 * image->words + 2 && image->blocks > 0);
}

void read_as_device(std::span<const std::uint8_t> bytes) {
  VirtualClock clock;
  auto owned = std::make_unique<FuzzedLink>(bytes);
  FuzzedLink& link = *owned;
  FalconOptions options;
  options.pause = [](int) {};
  FalconDevice device(std::move(owned), clock, options);
  must(device.open().ok());
  link.booted = true;
  ForceGovernor governor = ForceGovernor::create(device.limits(), {}).value();
  governor.arm(0.0);
  for (std::size_t frames = 0;; ++frames) {
    clock.advance(1e-3);
    const DeviceState state = device.read();
    // Thigh, shin and stubs in a line reach 185 mm from the base's edge.
    must(is_finite(state.position_mm) && state.position_mm.norm() < 400.0);
    device.send(governor.govern(clock.now_s(), state, Vec3{1.0, -0.5, 0.5}));
    must(state.homed || !link.pushes);
    must(governor.fault() == Fault::kNone || !link.pushes);
    if (state.status == ReadStatus::kLost) break;
    must(frames <= bytes.size());
  }
}

}  // namespace
}  // namespace palpate::device

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::span<const std::uint8_t> bytes(data, size);
  palpate::device::read_as_image(bytes);
  palpate::device::read_as_replies(bytes);
  palpate::device::read_as_device(bytes);
  return 0;
}
