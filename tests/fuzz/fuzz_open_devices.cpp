// Fuzzes open devices and their description file. The first byte selects: a report8, b report14, c lines of
// text, s 3Dconnexion, p Haply's plane, d description. Device input comes in pieces whose sizes are bytes of
// it. Positions are finite, only zero or currents within the cap go out, and a device that is not homed moves
// nothing.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/device/force_governor.h>
#include "device/arms/arm_device.h"
#include "device/haply/planar_device.h"
#include "device/spacemouse/spacemouse_device.h"
#include "tests/fuzz/must.h"

namespace palpate::device {
namespace {

/// Gives the input in pieces whose sizes are bytes of it; checks what is sent.
class FuzzedLink final : public Link {
 public:
  using Check = void (*)(std::span<const std::uint8_t>);
  FuzzedLink(std::span<const std::uint8_t> bytes, Check check) : bytes_(bytes), check_(check) {}
  Status open() override { return Done{}; }
  void close() noexcept override {}
  bool submit(std::span<const std::uint8_t> bytes) noexcept override {
    check_(bytes);
    return true;
  }
  Polled poll(std::span<std::uint8_t> into) noexcept override {
    if (at_ == bytes_.size()) return {0, true};
    const std::uint8_t piece = bytes_[at_++];
    const std::size_t most = std::min(into.size(), bytes_.size() - at_);
    const std::size_t size = std::min<std::size_t>(most, piece % 66U);
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(at_), size, into.begin());
    at_ += size;
    return {size, false};
  }

 private:
  std::span<const std::uint8_t> bytes_;
  Check check_;
  std::size_t at_ = 0;
};

constexpr int kCapMa = 2000;  // of the known arms

void check_words(std::span<const std::uint8_t> bytes) {
  must(bytes.size() >= 8 && bytes.size() <= 64);
  const auto word = [&](std::size_t i) {
    return static_cast<std::int16_t>(bytes[2 * i] | (bytes[2 * i + 1] << 8));
  };
  if (bytes.size() >= 14 && word(3) == 1) return;  // sets counters
  for (std::size_t i = 0; i < 3; ++i) must(std::abs(int{word(i)}) <= kCapMa);
}

void check_text(std::span<const std::uint8_t> bytes) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  must(text.size() >= 16 && text.front() == '[' && text.back() == '\n');
  int a = 0, b = 0, c = 0;
  must(std::sscanf(std::string(text).c_str(), "[%d,%d,%d]", &a, &b, &c) == 3);
  must(std::abs(a) <= kCapMa && std::abs(b) <= kCapMa && std::abs(c) <= kCapMa);
}

void check_plane(std::span<const std::uint8_t> bytes) {
  must(bytes.size() == 10 || bytes.size() == 26);
  if (bytes.size() != 10) return;
  for (const std::size_t at : {std::size_t{2}, std::size_t{6}}) {
    float torque = 0.0F;
    std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(at), 4, reinterpret_cast<std::uint8_t*>(&torque));
    must(std::isfinite(torque) && std::abs(torque) <= 0.12301F);
  }
}

void check_lamp(std::span<const std::uint8_t> bytes) {
  must(bytes.size() == 2 && bytes[0] == 4);
}

/// Runs until the link is gone, with a governor that wants 3 N.
void run_frames(Device& device, VirtualClock& clock, std::size_t most) {
  must(device.open().ok());
  ForceGovernor governor = ForceGovernor::create(device.limits(), {}).value();
  governor.arm(clock.now_s());
  for (std::size_t frames = 0;; ++frames) {
    const DeviceState state = device.read();
    must(is_finite(state.position_mm) && state.raw.size <= RawPacket::kMost);
    if (state.status == ReadStatus::kLost) break;
    if (governor.fault() != Fault::kNone) governor.arm(clock.now_s());
    device.send(governor.govern(clock.now_s(), state, Vec3(1.0, -2.0, 2.0)));
    clock.advance(1e-3);
    must(frames <= most);
  }
  must(!device.cut_force() || device.name() != "spacemouse");
}

ArmDescription built_in_arm(std::string_view name) {
  static const std::vector<KnownArm> all = built_in_arms();
  for (const KnownArm& one : all)
    if (one.name == name) return parse_arm_description(one.text, one.name).value();
  std::abort();
}

void run_arm(const ArmDescription& described, std::span<const std::uint8_t> bytes) {
  ArmDescription arm = described;
  // Skips lying still for half a second.
  if (arm.form == ArmForm::kReport8) arm.rest = ArmRest::kPowerOn;
  const FuzzedLink::Check check = arm.form == ArmForm::kText ? &check_text : &check_words;
  VirtualClock clock;
  ArmDevice device(arm, std::make_unique<FuzzedLink>(bytes, check), clock, {0});
  run_frames(device, clock, bytes.size());
}

void run_description(std::span<const std::uint8_t> bytes) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  const Result<ArmDescription> arm = parse_arm_description(text, "fuzzed.toml");
  if (!arm) {
    must(!arm.error().what.empty() && arm.error().file == "fuzzed.toml");
    return;
  }
  must(arm->current_cap_a > 0.0 && arm->current_cap_a <= 6.0 && arm->limits.force_max_n > 0.0);
  const auto pose = arm_pose(arm->geometry, arm->angles_of(arm->rest_counts));
  must(pose.has_value() && is_finite(pose->position_mm));
}

}  // namespace
}  // namespace palpate::device

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate::device;
  if (size == 0) return 0;
  const std::span<const std::uint8_t> bytes(data + 1, size - 1);
  palpate::VirtualClock clock;
  static const ArmDescription wood_arm = built_in_arm("woodenhaptics"), second = built_in_arm("polhem-v2"),
                              third = built_in_arm("polhem-v3");
  switch (data[0]) {
    case 'a':
      run_arm(wood_arm, bytes);
      break;
    case 'b':
      run_arm(second, bytes);
      break;
    case 'c':
      run_arm(third, bytes);
      break;
    case 's': {
      SpaceMouseDevice device(std::make_unique<FuzzedLink>(bytes, &check_lamp), clock,
                              spacemouse_models()[0]);
      run_frames(device, clock, bytes.size());
      break;
    }
    case 'p': {
      PlanarOptions options;
      options.open_tries = 0;
      PlanarDevice device(std::make_unique<FuzzedLink>(bytes, &check_plane), clock, *planar_model(2),
                          options);
      run_frames(device, clock, bytes.size());
      break;
    }
    case 'd':
      run_description(bytes);
      break;
    default:
      break;
  }
  return 0;
}
