#include "device/simulated/simulated_device.h"

#include <limits>
#include <utility>

namespace palpate::device {

SimulatedDevice::SimulatedDevice(const trace::ProbePath& path, const Clock& clock, const DeviceLimits& limits,
                                 std::size_t max_sent, std::vector<ScriptedFault> faults)
    : path_(path), clock_(clock), limits_(limits), max_sent_(max_sent), faults_(std::move(faults)) {
  sent_.reserve(max_sent);
}

Status SimulatedDevice::open() {
  if (path_.size() == 0 || path_.hip_mm.size() != path_.size())
    return Error{"the simulated device has no path to play", "give a path with samples", path_.name};
  open_ = true;
  opened_s_ = clock_.now_s();
  last_read_s_ = -1.0;
  sample_ = 0;
  last_ = {};
  last_.position_mm = path_.hip_mm[0];
  held_n_.setZero();
  return Done{};
}

void SimulatedDevice::close() noexcept {
  open_ = false;
  held_n_.setZero();
}

DeviceState SimulatedDevice::read() noexcept {
  last_.status = ReadStatus::kNothingNew;
  if (!open_) {
    last_.status = ReadStatus::kLost;
    return last_;
  }
  const double t_s = clock_.now_s() - opened_s_;
  Vec3 offset_mm = Vec3::Zero();
  for (const ScriptedFault& fault : faults_) {
    if (t_s < fault.start_s || t_s >= fault.start_s + fault.duration_s) continue;
    switch (fault.kind) {
      case ScriptedFault::Kind::kSilence:
        return last_;
      case ScriptedFault::Kind::kLost: {
        DeviceState lost = last_;
        lost.status = ReadStatus::kLost;
        return lost;
      }
      case ScriptedFault::Kind::kNonFinitePosition: {
        DeviceState broken = last_;
        broken.status = ReadStatus::kFresh;
        broken.position_mm.setConstant(std::numeric_limits<double>::quiet_NaN());
        return broken;
      }
      case ScriptedFault::Kind::kJump:
        offset_mm += fault.jump_mm;
        break;
    }
  }
  if (t_s == last_read_s_) return last_;  // same instant: nothing new
  last_read_s_ = t_s;
  // Path times count from the first sample. Clock and path times are rounded: a sample missed by less than a
  // millionth of its interval is reached.
  constexpr double kReachedShare = 1e-6;
  while (sample_ + 1 < path_.size()) {
    const double due_s = path_.t_s[sample_ + 1] - path_.t_s[0];
    const double slack_s = kReachedShare * (path_.t_s[sample_ + 1] - path_.t_s[sample_]);
    if (t_s < due_s - slack_s) break;
    ++sample_;
  }
  last_.status = ReadStatus::kFresh;
  last_.position_mm = path_.hip_mm[sample_] + offset_mm;
  return last_;
}

void SimulatedDevice::send(GovernedForce force) noexcept {
  if (!open_) return;
  held_n_ = force.newtons();
  if (sent_.size() < max_sent_) {
    sent_.push_back({clock_.now_s(), held_n_});
  } else {
    ++unrecorded_;
  }
}

}  // namespace palpate::device
