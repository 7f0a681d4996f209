#include "device/falcon/falcon_device.h"

#include <time.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "toolkit/core/try.h"

namespace palpate::device {
namespace {

// One damaged reply happens. Three in a row, and nothing that comes can be believed.
constexpr std::uint32_t kFalconMostBad = 3;
constexpr std::size_t kFalconPollBytes = 64;
constexpr int kCloseTries = 20;  // ms that closing waits for room: the queue drains within one or two

// The whole of this sphere is in reach, with the Jacobian's determinant within a factor of 3.5.
constexpr double kReachMm = 40.0;
constexpr double kStepMm = 0.05;       // one count on each motor, rms, across
constexpr double kFalconRateHz = 1e3;  // of full-speed USB
// What the maker and users' libraries state; 1 to 1.5 N/mm is said to stay quiet.
constexpr double kFalconStiffness = 3.0, kFalconDamping = 0.020;

void sleep_ms(int ms) {
  constexpr long kNsPerMs = 1'000'000;
  constexpr int kMsPerS = 1000;
  const timespec time{ms / kMsPerS, (ms % kMsPerS) * kNsPerMs};
  ::nanosleep(&time, nullptr);
}

std::uint8_t flags_of(bool homed) noexcept {
  return static_cast<std::uint8_t>(FalconCommand::kHoming |
                                   (homed ? FalconCommand::kGreen : FalconCommand::kRed));
}

const Vec3 kFalconMiddle{0.0, 0.0, kFalconCentreMm};

}  // namespace

std::string falcon_homing_prompt(std::uint8_t homed_legs) {
  int legs = 0;
  for (int leg = 0; leg < 3; ++leg) legs += (homed_legs >> leg) & 1;
  if (legs == 3) return {};
  return "Pull the grip all the way out, then push it all the way in (" + std::to_string(legs) +
         " of 3 legs know their zero)";
}

FalconBytes falcon_zero() noexcept {
  return encoded(FalconCommand{{}, flags_of(false)});
}

FalconDevice::FalconDevice(std::unique_ptr<ControlLink> link, const Clock& clock, FalconOptions options)
    : link_(std::move(link)), clock_(clock), options_(std::move(options)), zero_(falcon_zero()) {
  if (!options_.pause) options_.pause = sleep_ms;
  if (!options_.firmware) options_.firmware = [] { return find_falcon_firmware(falcon_firmware_places({})); };
}

// Ready with zero force commanded: the probe for firmware sends nothing else.
Status FalconDevice::open() {
  close();
  if (!std::isfinite(options_.counts_per_n_mm) || !(options_.counts_per_n_mm > 0.0))
    return Error{"the Falcon's scale from torque to motor counts is not right", "give a number above 0",
                 name(), 0};
  PALPATE_TRY(link_->open());
  Result<FalconBooted> booted =
      boot_falcon(*link_, {options_.firmware, options_.pause, options_.event_character});
  if (!booted) {
    link_->close();
    return std::move(booted).error();
  }
  booted_ = std::move(booted).value();
  reader_.clear();
  counters_ = {};
  state_ = {};
  state_.homed = false;  // until all legs say so
  arm_mm_ = kFalconMiddle;
  homed_legs_ = 0;
  unreachable_in_a_row_ = 0;
  open_ = true;
  return Done{};
}

void FalconDevice::close() noexcept {
  if (!open_) return;
  open_ = false;
  for (int tries = 0; !link_->submit(zero_) && tries < kCloseTries && !link_->poll({}).gone; ++tries)
    options_.pause(1);
  link_->close();
}

DeviceLimits FalconDevice::limits() const noexcept {
  return {options_.calibrated ? kFalconForce : kFalconFirstForce,
          {Vec3::Constant(-kReachMm), Vec3::Constant(kReachMm)},
          kStepMm,
          kFalconRateHz,
          kFalconStiffness,
          kFalconDamping,
          WorkspaceShape::kEllipsoid};
}

DeviceState FalconDevice::read() noexcept {
  state_.status = open_ ? ReadStatus::kNothingNew : ReadStatus::kLost;
  std::array<std::uint8_t, kFalconPollBytes> bytes;
  std::optional<FalconReply> newest;
  std::uint8_t homed_in_all = FalconReply::kAllLegs;  // a flag that dropped for one reply has dropped
  for (int i = 0; open_ && i < kMostPolls; ++i) {
    const Polled polled = link_->poll(bytes);
    for (const std::uint8_t byte : ftdi_payload(std::span(bytes).first(polled.size)))
      if (const std::optional<FalconReply> reply = reader_.take(byte)) {
        newest = reply;
        homed_in_all &= reply->homed;
        ++counters_.replies;
      }
    if (polled.gone) state_.status = ReadStatus::kLost;
    if (polled.size == 0 || polled.gone) break;
  }
  if (state_.status == ReadStatus::kLost) return state_;
  if (newest) {
    // While legs are being homed one after the other the newest counts; afterwards the worst.
    if (state_.homed) newest->homed = homed_in_all;
    take(*newest);
  }
  if (state_.status == ReadStatus::kNothingNew &&
      (reader_.malformed_in_a_row() >= kFalconMostBad || unreachable_in_a_row_ >= kFalconMostBad))
    state_.status = ReadStatus::kGarbled;
  return state_;
}

void FalconDevice::take(const FalconReply& reply) noexcept {
  const bool homed = reply.homed == FalconReply::kAllLegs;
  if (homed && !state_.homed) arm_mm_ = kFalconMiddle;  // counters have jumped: what was is no guess
  homed_legs_ = state_.homing_step = reply.homed;
  state_.homed = homed;
  state_.buttons = reply.buttons;
  if (homed) {
    const Vec3 angles = falcon_angles_of_counts(Vec3{static_cast<double>(reply.counts[0]),
                                                     static_cast<double>(reply.counts[1]),
                                                     static_cast<double>(reply.counts[2])});
    FalconPose pose = falcon_position(angles, arm_mm_);
    if (!pose.converged) pose = falcon_position(angles, kFalconMiddle);
    if (!pose.converged) {
      ++counters_.unreachable;
      ++unreachable_in_a_row_;
      return;  // the last position holds, and is not fresh
    }
    arm_mm_ = pose.position_mm;
    state_.position_mm = arm_mm_ - kFalconMiddle;
  }
  unreachable_in_a_row_ = 0;
  state_.packet_ns = clock_.now_ns();
  std::copy(reader_.bytes().begin(), reader_.bytes().end(), state_.raw.bytes.begin());
  state_.raw.size = static_cast<std::uint8_t>(kFalconPacketBytes);
  state_.status = ReadStatus::kFresh;
}

bool FalconDevice::submit(const FalconBytes& bytes) noexcept {
  const bool taken = link_->submit(bytes);
  if (!taken) ++counters_.refused;
  return taken;
}

// Every frame, zero included: motors may hold the last command for ever.
void FalconDevice::send(GovernedForce force) noexcept {
  if (!open_) return;
  FalconCommand command;
  command.flags = flags_of(state_.homed);
  const Vec3& newtons = force.newtons();
  if (state_.homed && newtons != Vec3::Zero()) {
    const std::optional<Vec3> angles = falcon_angles(arm_mm_);
    const std::optional<Mat3> jacobian = angles ? falcon_jacobian(arm_mm_, *angles) : std::nullopt;
    const std::optional<Vec3> torques = jacobian ? falcon_torques(*jacobian, newtons) : std::nullopt;
    if (torques) command.motors = falcon_motors(*torques, options_.counts_per_n_mm);
  }
  submit(encoded(command));
}

// Another thread's: touches nothing but the link and what the constructor has made.
bool FalconDevice::cut_force() noexcept {
  return link_->submit(zero_);
}

FalconCounters FalconDevice::counters() const noexcept {
  FalconCounters counters = counters_;
  counters.malformed = reader_.malformed();
  counters.dropped = reader_.dropped();
  return counters;
}

}  // namespace palpate::device
