#include "device/arms/arm_device.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include <palpate/result.h>

namespace palpate::device {
namespace {

constexpr std::size_t kPollBytes = 65;  // a padded report with its id
constexpr std::uint32_t kMaxMalformedReports = 3;
constexpr std::int64_t kNsPerMs = 1'000'000;
// Without an answer for this long a command counts as lost. Equals the governor's silence limit.
constexpr std::int64_t kWakeNs = 20 * kNsPerMs;
// A position older than this drives no motor, not even against the arm's weight.
constexpr std::int64_t kStaleNs = 20 * kNsPerMs;
// At rest means at most this motion for this long. An encoder at an edge flickers by one count to each side.
constexpr std::int64_t kStillCounts = 2, kStillNs = 500 * kNsPerMs;
// Tolerance of counters the arm has set to the rest pose: a hand's motion within two reports, at most 0.004
// rad for published arms.
constexpr double kSetCountsWithin = 16.0;
// Fastest joint: a hand at 2 m/s on a lever of 40 mm. Two reports close together may still show the motion of
// a whole period.
constexpr double kMaxRadPerS = 50.0, kMinReportS = 2e-3;
constexpr std::int64_t kWeightRampNs = 1000 * kNsPerMs;  // as long as the longest soft start
constexpr std::int32_t kPressedAbove = 5000, kPressedAdds = 10000;
constexpr useconds_t kOpenStepUs = 5000;
constexpr int kOpenWakeEvery = 20;  // polls: 0.1 s

std::int32_t wrapped_difference(std::int32_t now, std::int32_t before) noexcept {
  return static_cast<std::int16_t>(static_cast<std::uint16_t>(now) - static_cast<std::uint16_t>(before));
}

double whole_ma(double current_ma, double cap_ma) noexcept {
  constexpr double kRounding = 1.0 + 1e-12;  // allows for rounding
  return std::trunc(std::clamp(current_ma * kRounding, -cap_ma, cap_ma));
}

}  // namespace

Milliamps limited_currents(const Vec3& force_ma, const Vec3& weight_ma, double cap_ma) noexcept {
  Milliamps currents{};
  if (!is_finite(force_ma) || !is_finite(weight_ma) || !(cap_ma > 0.0)) return currents;
  const double heaviest = weight_ma.cwiseAbs().maxCoeff();
  const Vec3 held = heaviest > cap_ma ? Vec3(weight_ma * (cap_ma / heaviest)) : weight_ma;
  double share = 1.0;
  for (int i = 0; i < 3; ++i) {
    const double room = force_ma[i] > 0.0 ? cap_ma - held[i] : cap_ma + held[i];
    if (std::abs(force_ma[i]) > room) share = std::min(share, std::max(0.0, room) / std::abs(force_ma[i]));
  }
  // Rounds towards zero, so that the cap holds. A product just below a whole milliampere counts as that.
  for (int i = 0; i < 3; ++i)
    currents[static_cast<std::size_t>(i)] =
        static_cast<std::int16_t>(whole_ma(held[i] + share * force_ma[i], cap_ma));
  return currents;
}

ArmDevice::ArmDevice(ArmDescription description, std::unique_ptr<Link> link, const Clock& clock,
                     const ArmDeviceOptions& options)
    : arm_(std::move(description)),
      link_(std::move(link)),
      clock_(clock),
      options_(options),
      zero_(encoded_currents(arm_.form, arm_.report_bytes, {})) {}

// Commands zero force, which ends what an earlier program left in the motors.
Status ArmDevice::open() {
  close();
  PALPATE_TRY(link_->open());
  state_ = {};
  state_.homed = false;
  counters_ = {};
  lines_.clear();
  pose_.reset();
  gone_ = counted_ = setting_ = set_sent_ = lost_rest_ = calibrate_before_ = false;
  malformed_in_a_row_ = 0;
  still_from_ns_ = 0;
  cut_ = false;
  if (!link_->submit(zero_.span())) {
    link_->close();
    return Error{"the arm takes no command", "check its cable and power", name()};
  }
  open_ = awaiting_ = sent_zero_ = true;
  sent_ns_ = clock_.now_ns();
  for (int look = 1; look <= options_.open_tries && !counted_; ++look) {
    ArmReport report;
    if (poll_newest(report)) {
      take(report);
      awaiting_ = false;
    }
    if (counted_ || gone_) break;
    if (look % kOpenWakeEvery == 0) link_->submit(zero_.span());
    ::usleep(kOpenStepUs);
  }
  if (counted_ || options_.open_tries == 0) return Done{};
  close();
  return Error{
      gone_ ? "the arm was unplugged" : "the arm is silent, or speaks otherwise than its description says",
      "check its power, and 'form', 'report_bytes' and 'model' of its description", name()};
}

void ArmDevice::close() noexcept {
  if (!open_) return;
  open_ = false;
  link_->submit(zero_.span());
  link_->close();
}

bool ArmDevice::take_text(std::span<const std::uint8_t> bytes, ArmReport& newest) noexcept {
  bool found = false;
  for (const std::uint8_t byte : bytes) {
    const std::uint32_t before = lines_.malformed_in_a_row();
    if (const std::optional<ArmReport> report = lines_.take(byte)) {
      newest = *report;
      found = true;
      ++counters_.reports;
    } else if (lines_.malformed_in_a_row() != before) {
      ++counters_.malformed;
    }
  }
  if (found) state_.raw.keep(lines_.line());
  malformed_in_a_row_ = lines_.malformed_in_a_row();
  return found;
}

bool ArmDevice::poll_newest(ArmReport& newest) noexcept {
  std::array<std::uint8_t, kPollBytes> bytes;
  bool found = false, calibrate = false;
  for (int i = 0; i < kMaxPolls; ++i) {
    const Polled polled = link_->poll(bytes);
    gone_ = gone_ || polled.gone;
    if (polled.size == 0) break;
    const std::span<const std::uint8_t> came = std::span(bytes).first(polled.size);
    if (arm_.form == ArmForm::kText) {
      found = take_text(came, newest) || found;
    } else if (const auto report = decoded_report(arm_.form, arm_.report_bytes, came)) {
      newest = *report;
      calibrate = calibrate || report->calibrate;
      found = true;
      malformed_in_a_row_ = 0;
      ++counters_.reports;
      state_.raw.keep(came);
    } else {
      ++malformed_in_a_row_;
      ++counters_.malformed;
    }
    if (gone_) break;
  }
  newest.calibrate = calibrate;
  return found;
}

DeviceState ArmDevice::read() noexcept {
  state_.status = open_ && !gone_ ? ReadStatus::kNothingNew : ReadStatus::kLost;
  if (state_.status == ReadStatus::kLost) return state_;
  ArmReport report;
  if (poll_newest(report)) {
    awaiting_ = false;
    take(report);
  }
  state_.homing_step = static_cast<std::uint8_t>(step());
  if (gone_)
    state_.status = ReadStatus::kLost;
  else if (state_.status == ReadStatus::kNothingNew && malformed_in_a_row_ >= kMaxMalformedReports)
    state_.status = ReadStatus::kGarbled;
  return state_;
}

void ArmDevice::take(const ArmReport& report) noexcept {
  if (arm_.form == ArmForm::kReport8 && counted_ && report.counter == counter_) return;
  counter_ = report.counter;
  const bool other =
      arm_.form == ArmForm::kText && (report.error != 0 || (arm_.model != 0 && report.model != arm_.model));
  if (other) {
    ++counters_.strange;
    state_.status = ReadStatus::kGarbled;
    return;
  }
  const std::int64_t now_ns = clock_.now_ns();
  count_on(report, now_ns);
  find_rest(report, now_ns);
  state_.buttons = arm_.button == ArmButton::kEncoderD && report.counts[3] > kPressedAbove ? 1U : 0U;
  state_.packet_ns = now_ns;
  state_.status = ReadStatus::kFresh;
  pose_.reset();
  if (!state_.homed) return;
  std::array<double, 3> counts{};
  for (std::size_t i = 0; i < counts.size(); ++i) counts[i] = static_cast<double>(run_[i]) + offset_[i];
  angles_ = arm_.angles_of(counts);
  pose_ = arm_pose(arm_.geometry, angles_);
  if (pose_) {
    state_.position_mm = pose_->position_mm;
    return;
  }
  // An impossible pose: the last position stays, without force.
  ++counters_.strange;
  state_.status = ReadStatus::kGarbled;
}

/// Unwraps the counters. A jump means a reset, for example by a power loss: the position is unknown until the
/// arm is at rest again.
void ArmDevice::count_on(const ArmReport& report, std::int64_t now_ns) noexcept {
  const bool wraps = arm_.form != ArmForm::kText;
  const double elapsed_s = 1e-9 * static_cast<double>(now_ns - state_.packet_ns);
  bool jumped = false;
  for (std::size_t i = 0; i < raw_.size(); ++i) {
    const std::int32_t moved = !counted_ ? report.counts[i]
                               : wraps   ? wrapped_difference(report.counts[i], raw_[i])
                                         : report.counts[i] - raw_[i];
    run_[i] = counted_ ? run_[i] + moved : moved;
    raw_[i] = report.counts[i];
    const double turned = std::abs(moved * arm_.rad_per_count(i));
    jumped = jumped || (counted_ && turned > kMaxRadPerS * std::max(kMinReportS, elapsed_s));
  }
  counted_ = true;
  if (!jumped || !state_.homed) return;
  ++counters_.jumps;
  state_.homed = false;
  lost_rest_ = true;
}

void ArmDevice::rest_here(std::int64_t now_ns) noexcept {
  for (std::size_t i = 0; i < offset_.size(); ++i)
    offset_[i] = arm_.rest_counts[i] - static_cast<double>(run_[i]);
  state_.homed = true;
  homed_ns_ = now_ns;
  setting_ = lost_rest_ = false;
}

void ArmDevice::find_rest(const ArmReport& report, std::int64_t now_ns) noexcept {
  const bool pressed = report.calibrate && !calibrate_before_;
  calibrate_before_ = report.calibrate;
  if (state_.homed && !pressed) return;
  bool at_rest = false;
  switch (arm_.rest) {
    case ArmRest::kButton:
      at_rest = pressed;
      break;
    case ArmRest::kPowerOn:
      if (lost_rest_) return;  // counters restarted at an unknown place
      offset_ = arm_.rest_counts;
      for (std::size_t i = 0; i < run_.size(); ++i) run_[i] = raw_[i];
      state_.homed = true;
      homed_ns_ = now_ns;
      return;
    case ArmRest::kStart: {
      if (lost_rest_ || state_.homed) return;  // lying still elsewhere is not the rest pose
      bool still = still_from_ns_ != 0;
      for (std::size_t i = 0; i < run_.size(); ++i)
        still = still && std::abs(run_[i] - still_[i]) <= kStillCounts;
      if (!still) {
        still_ = run_;
        still_from_ns_ = std::max<std::int64_t>(now_ns, 1);
      }
      at_rest = still && now_ns - still_from_ns_ >= kStillNs;
      break;
    }
  }
  if (at_rest && !arm_.rest_in_firmware) rest_here(now_ns);
  if (at_rest && arm_.rest_in_firmware && !setting_) {
    setting_ = true;
    set_sent_ = false;
    state_.homed = false;
  }
  if (!setting_ || !set_sent_) return;
  // The arm shows the rest pose after it received it.
  for (std::size_t i = 0; i < raw_.size(); ++i)
    if (std::abs(raw_[i] - arm_.rest_counts[i]) > kSetCountsWithin) return;
  for (std::size_t i = 0; i < raw_.size(); ++i) run_[i] = raw_[i];
  offset_ = {};
  state_.homed = true;
  homed_ns_ = now_ns;
  setting_ = lost_rest_ = false;
}

Vec3 ArmDevice::weight_ma(std::int64_t now_ns) const noexcept {
  if (!arm_.weight || cut_.load(std::memory_order_relaxed)) return Vec3::Zero();
  const double gain =
      std::clamp(static_cast<double>(now_ns - homed_ns_) / static_cast<double>(kWeightRampNs), 0.0, 1.0);
  Vec3 currents = gain * weight_torques_n_mm(arm_.geometry, arm_.masses, angles_);
  for (int i = 0; i < 3; ++i) currents[i] *= arm_.ma_per_n_mm(static_cast<std::size_t>(i));
  return currents;
}

CommandBytes ArmDevice::command_for(const Vec3& force_n) noexcept {
  const std::int64_t now_ns = clock_.now_ns();
  if (!state_.homed || !pose_ || now_ns - state_.packet_ns > kStaleNs) return zero_;
  Vec3 force_ma = torques_n_mm(*pose_, force_n);
  for (int i = 0; i < 3; ++i) force_ma[i] *= arm_.ma_per_n_mm(static_cast<std::size_t>(i));
  constexpr double kMaPerA = 1e3;
  const double cap_ma = kMaPerA * arm_.current_cap_a;
  const Vec3 held_ma = weight_ma(now_ns);
  if ((force_ma + held_ma).cwiseAbs().maxCoeff() > cap_ma) ++counters_.limited;
  return encoded_currents(arm_.form, arm_.report_bytes, limited_currents(force_ma, held_ma, cap_ma));
}

// Called every frame, also for zero.
void ArmDevice::send(GovernedForce force) noexcept {
  if (!open_ || gone_) return;
  const Vec3 newtons = force.newtons();
  const bool zero = newtons == Vec3::Zero();
  if (!zero) cut_.store(false, std::memory_order_relaxed);
  const std::int64_t now_ns = clock_.now_ns();
  const bool force_ends = zero && !sent_zero_;  // sent outside the command rhythm
  if (alternates(arm_.form) && awaiting_ && !force_ends) {
    if (now_ns - sent_ns_ < kWakeNs) return;
    ++counters_.woken;
  }
  CommandBytes command;
  if (setting_) {
    std::array<std::int16_t, 6> counts{};
    for (std::size_t i = 0; i < arm_.rest_counts.size(); ++i)
      counts[i] = static_cast<std::int16_t>(std::lround(arm_.rest_counts[i]));
    command = encoded_counts(arm_.report_bytes, counts);
    set_sent_ = true;
  } else {
    command = command_for(newtons);
  }
  link_->submit(command.span());
  awaiting_ = true;
  sent_zero_ = zero;
  sent_ns_ = now_ns;
}

// Called by another thread: uses only the link, a flag and data fixed by the constructor.
bool ArmDevice::cut_force() noexcept {
  cut_.store(true, std::memory_order_relaxed);
  return link_->submit(zero_.span());
}

ArmStep ArmDevice::step() const noexcept {
  if (!open_ || state_.homed) return ArmStep::kNothing;
  if (lost_rest_ && arm_.rest != ArmRest::kButton) return ArmStep::kSwitchOffAndOn;
  switch (arm_.rest) {
    case ArmRest::kStart:
      return ArmStep::kLieStill;
    case ArmRest::kButton:
      return ArmStep::kPressButton;
    case ArmRest::kPowerOn:
      return ArmStep::kWait;
  }
  return ArmStep::kNothing;
}

std::string arm_homing_prompt(std::uint8_t homing_step) {
  constexpr std::array kPrompts = {
      "", "Lay the arm in its rest pose and let go for half a second",
      "Hold the arm in its rest pose and press its calibration button", "Wait for the arm's first line",
      "The arm's counters jumped: lay it in its rest pose, switch it off and on, and start again"};
  static_assert(kPrompts.size() == static_cast<std::size_t>(ArmStep::kSwitchOffAndOn) + 1);
  return homing_step < kPrompts.size() ? kPrompts[homing_step] : "";
}

}  // namespace palpate::device
