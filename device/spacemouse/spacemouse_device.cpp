#include "device/spacemouse/spacemouse_device.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

#include "toolkit/core/try.h"

namespace palpate::device {
namespace {

constexpr double kFullPush = 350.0;  // counts; some go a little beyond
constexpr std::size_t kPollBytes = 65;
constexpr std::uint32_t kMostMalformed = 3;
// The slowest report every 16 ms while pushed.
constexpr std::int64_t kSilenceNs = 100'000'000;
// A frame that comes later moves the HIP no further: it must not leap after a pause.
constexpr double kMostFrameS = 0.02;
constexpr double kRateHz = 1000.0;  // of integration; reports come at 62 to 125
constexpr double kSteps = 1e-3;     // of full speed over a frame: below it nothing moves on purpose
constexpr std::array<std::uint8_t, 2> kLampOn = {0x04, 0x01}, kLampOff = {0x04, 0x00};

}  // namespace

Status check_spacemouse(const SpaceMouseOptions& options) {
  const auto wrong = [](const char* name, const char* remedy) {
    return Error{std::string(name) + " is out of range", remedy, "spacemouse", 0};
  };
  const auto above_zero = [](double value) { return std::isfinite(value) && value > 0.0; };
  if (!above_zero(options.v_max_mm_per_s)) return wrong("v_max_mm_per_s", "give a speed above 0");
  if (!(options.dead_zone >= 0.0 && options.dead_zone < 1.0))
    return wrong("dead_zone", "give a share from 0 to below 1");
  if (!(options.curve >= 1.0 && std::isfinite(options.curve)))
    return wrong("curve", "give an exponent of 1 or above");
  if (!above_zero(options.half_extent_mm)) return wrong("half_extent_mm", "give a length above 0");
  if (!above_zero(options.force_max_n)) return wrong("force_max_n", "give a force above 0");
  return Done{};
}

double spacemouse_speed(double counts, const SpaceMouseOptions& options) noexcept {
  const double push = std::min(1.0, std::abs(counts) / kFullPush);
  if (push <= options.dead_zone) return 0.0;
  const double beyond = (push - options.dead_zone) / (1.0 - options.dead_zone);
  return std::copysign(options.v_max_mm_per_s * std::pow(beyond, options.curve), counts);
}

SpaceMouseDevice::SpaceMouseDevice(std::unique_ptr<Link> link, const Clock& clock,
                                   const SpaceMouseModel& model, const SpaceMouseOptions& options)
    : link_(std::move(link)), clock_(clock), model_(model), options_(options) {}

Status SpaceMouseDevice::open() {
  close();
  PALPATE_TRY(check_spacemouse(options_));
  PALPATE_TRY(link_->open());
  state_ = {};
  velocity_mm_s_.setZero();
  moved_ns_ = heard_ns_ = clock_.now_ns();
  gone_ = silent_ = false;
  malformed_in_a_row_ = 0;
  open_ = true;
  (void)link_->submit(kLampOn);  // not every model has one
  return Done{};
}

void SpaceMouseDevice::close() noexcept {
  if (!open_) return;
  open_ = false;
  link_->submit(kLampOff);
  link_->close();
}

DeviceLimits SpaceMouseDevice::limits() const noexcept {
  DeviceLimits limits;
  limits.force_max_n = options_.force_max_n;
  limits.workspace_mm = {Vec3::Constant(-options_.half_extent_mm), Vec3::Constant(options_.half_extent_mm)};
  limits.resolution_mm = kSteps * options_.v_max_mm_per_s / kRateHz;
  limits.rate_hz = kRateHz;
  return limits;
}

void SpaceMouseDevice::take(const SpaceMouseReport& report, std::int64_t now_ns) noexcept {
  using Kind = SpaceMouseReport::Kind;
  heard_ns_ = now_ns;
  silent_ = false;
  if (report.kind == Kind::kButtons) state_.buttons = report.buttons;
  if (report.kind != Kind::kAxes) return;
  const Vec3 counts(report.axes[0], report.axes[1], report.axes[2]);
  const Vec3 turned = model_.axes_as_is ? counts : Vec3(counts.x(), -counts.z(), -counts.y());
  for (int i = 0; i < 3; ++i) velocity_mm_s_[i] = spacemouse_speed(turned[i], options_);
}

DeviceState SpaceMouseDevice::read() noexcept {
  const std::int64_t now_ns = clock_.now_ns();
  std::array<std::uint8_t, kPollBytes> bytes;
  for (int i = 0; open_ && !gone_ && i < kMostPolls; ++i) {
    const Polled polled = link_->poll(bytes);
    gone_ = polled.gone;
    if (polled.size == 0) break;
    const std::span<const std::uint8_t> came = std::span(bytes).first(polled.size);
    const std::optional<SpaceMouseReport> report = decoded_spacemouse(came);
    malformed_in_a_row_ = report ? 0 : malformed_in_a_row_ + 1;
    if (!report) continue;
    take(*report, now_ns);
    state_.raw.size = static_cast<std::uint8_t>(std::min(came.size(), RawPacket::kMost));
    std::copy_n(came.begin(), state_.raw.size, state_.raw.bytes.begin());
  }
  if (velocity_mm_s_ != Vec3::Zero() && now_ns - heard_ns_ > kSilenceNs) {
    velocity_mm_s_.setZero();
    silent_ = true;
  }
  const double elapsed_s = std::clamp(1e-9 * static_cast<double>(now_ns - moved_ns_), 0.0, kMostFrameS);
  moved_ns_ = now_ns;
  state_.packet_ns = heard_ns_;
  if (!open_ || gone_ || silent_) {
    state_.status = ReadStatus::kLost;
    return state_;
  }
  if (malformed_in_a_row_ >= kMostMalformed) {
    velocity_mm_s_.setZero();
    state_.status = ReadStatus::kGarbled;
    return state_;
  }
  const Vec3 most = Vec3::Constant(options_.half_extent_mm);
  state_.position_mm = (state_.position_mm + elapsed_s * velocity_mm_s_).cwiseMax(-most).cwiseMin(most);
  state_.status = ReadStatus::kFresh;
  return state_;
}

}  // namespace palpate::device
