#include "device/haply/planar_device.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>
#include <utility>

#include "toolkit/core/try.h"

namespace palpate::device {
namespace {

constexpr std::size_t kPlanePollBytes = 64;
constexpr std::uint32_t kPlaneMostMalformed = 3;
constexpr std::int64_t kPlaneWakeNs = 20'000'000,
                       kPlaneStaleNs = 20'000'000;  // as long as the governor bears silence
constexpr useconds_t kPlaneOpenStepUs = 5000, kPlaneSetUpUs = 20000;
constexpr int kPlaneOpenWakeEvery = 20;  // looks: 0.1 s
// A board answers within a ms or two; a quiet line for longer, and all that was sent before is answered.
constexpr useconds_t kPlaneLookUs = 1000;
constexpr int kPlaneQuietLooks = 5, kPlaneAnswerLooks = 20, kPlaneLetGoRounds = 5;
// A reply does not say which command it answers: one that is later than a quiet line lets expect would vouch
// for a zero that the board has not taken.
constexpr int kPlaneZerosAnswered = 2;
constexpr double kPlaneRateHz = 1000.0;
// Where both editions reach without their bars nearing a line; tests walk it.
constexpr double kHalfWidthMm = 50.0, kHalfHeightMm = 30.0, kPlaneMiddleMm = 90.0;
constexpr double kHalfThicknessMm = 5.0;  // of a plane: a box must have some
constexpr double kPlaneDegree = std::numbers::pi / 180.0;

/// Whether a whole reply comes within so many looks.
bool plane_answers(Link& link, int looks) noexcept {
  PlanarReader reader;
  std::array<std::uint8_t, kPlanePollBytes> bytes;
  for (int look = 0; look < looks; ++look) {
    const Polled polled = link.poll(bytes);
    for (const std::uint8_t byte : std::span(bytes).first(polled.size))
      if (reader.take(byte)) return true;
    if (polled.gone) return false;
    if (polled.size == 0) ::usleep(kPlaneLookUs);
  }
  return false;
}

/// Throws away what comes until the line is quiet.
void await_quiet_plane(Link& link) noexcept {
  std::array<std::uint8_t, kPlanePollBytes> bytes;
  for (int look = 0, quiet = 0; look < kPlaneAnswerLooks && quiet < kPlaneQuietLooks; ++look) {
    ::usleep(kPlaneLookUs);
    quiet = link.poll(bytes).size == 0 ? quiet + 1 : 0;
  }
}

}  // namespace

bool planar_let_go(Link& link) noexcept {
  const CommandBytes let_go = encoded_let_go(), zero = encoded_torques({});
  for (int round = 0; round < kPlaneLetGoRounds; ++round) {
    if (!link.submit(let_go.span())) return false;
    int answered = 0;
    for (; answered < kPlaneZerosAnswered; ++answered) {
      await_quiet_plane(link);
      if (!link.submit(zero.span())) return false;
      if (!plane_answers(link, kPlaneAnswerLooks)) break;
    }
    if (answered == kPlaneZerosAnswered) return true;
  }
  return false;
}

PlanarDevice::PlanarDevice(std::unique_ptr<Link> link, const Clock& clock, const PlanarModel& model,
                           const PlanarOptions& options)
    : link_(std::move(link)), clock_(clock), model_(model), options_(options), zero_(encoded_torques({})) {}

Eigen::Vector2d PlanarDevice::origin_mm() const noexcept {
  return {0.5 * model_.geometry.between_mm, kPlaneMiddleMm};
}

Status PlanarDevice::open() {
  close();
  PALPATE_TRY(link_->open());
  state_ = {};
  state_.homed = false;  // until it has answered
  reader_ = {};
  pose_.reset();
  gone_ = false;
  // The first zeros are for what an earlier program left: its torque, should the board take any before it is
  // set up, and perhaps a part of a command, which takes its rest from the first of them. What the board
  // answers to that is of an earlier set-up.
  bool takes = link_->submit(zero_.span()) && link_->submit(zero_.span()) &&
               link_->submit(encoded_set_up(model_).span());
  if (options_.open_tries > 0) ::usleep(kPlaneSetUpUs);
  std::array<std::uint8_t, kPlanePollBytes> earlier;
  for (int i = 0; i < kMostPolls && link_->poll(earlier).size > 0; ++i) {
  }
  takes = takes && link_->submit(zero_.span());
  if (!takes) {
    link_->close();
    return Error{"the board takes no command", "check its cable and power", name(), 0};
  }
  open_ = awaiting_ = sent_zero_ = true;
  sent_ns_ = clock_.now_ns();
  for (int look = 1; look <= options_.open_tries && !state_.homed && !gone_; ++look) {
    poll_all();
    if (state_.homed) return Done{};
    if (look % kPlaneOpenWakeEvery == 0) link_->submit(zero_.span());
    ::usleep(kPlaneOpenStepUs);
  }
  if (options_.open_tries == 0) return Done{};
  close();
  return Error{gone_ ? "the board was unplugged" : "the board does not answer",
               "check its power, and that this serial line is the 2DIY's", name(), 0};
}

void PlanarDevice::close() noexcept {
  if (!open_) return;
  open_ = false;
  link_->submit(zero_.span());
  link_->close();
}

DeviceLimits PlanarDevice::limits() const noexcept {
  DeviceLimits limits;
  limits.force_max_n = options_.force_max_n;
  const Vec3 half(kHalfWidthMm, kHalfHeightMm, kHalfThicknessMm);
  limits.workspace_mm = {-half, half};
  // A count of both cranks, on the longer bars.
  limits.resolution_mm = std::numbers::sqrt2 * 2.0 * std::numbers::pi /
                         static_cast<double>(model_.counts_per_turn) * model_.geometry.bar_mm;
  limits.rate_hz = kPlaneRateHz;
  return limits;
}

void PlanarDevice::take(const std::array<float, 2>& degrees) noexcept {
  awaiting_ = false;
  state_.homed = true;
  state_.packet_ns = clock_.now_ns();
  std::copy(reader_.bytes().begin(), reader_.bytes().end(), state_.raw.bytes.begin());
  state_.raw.size = static_cast<std::uint8_t>(kPlanarReplyBytes);
  pose_ = pantograph_pose(model_.geometry, {kPlaneDegree * static_cast<double>(degrees[0]),
                                            kPlaneDegree * static_cast<double>(degrees[1])});
  // Where it cannot be there is no force; the last position stays.
  state_.status = pose_ ? ReadStatus::kFresh : ReadStatus::kGarbled;
  if (!pose_) return;
  const Eigen::Vector2d place = pose_->position_mm - origin_mm();
  state_.position_mm = Vec3(place.x(), place.y(), 0.0);
}

void PlanarDevice::poll_all() noexcept {
  std::array<std::uint8_t, kPlanePollBytes> bytes;
  for (int i = 0; i < kMostPolls; ++i) {
    const Polled polled = link_->poll(bytes);
    for (const std::uint8_t byte : std::span(bytes).first(polled.size))
      if (const auto degrees = reader_.take(byte)) take(*degrees);
    gone_ = gone_ || polled.gone;
    if (polled.size < bytes.size() || gone_) break;
  }
}

DeviceState PlanarDevice::read() noexcept {
  state_.status = open_ && !gone_ ? ReadStatus::kNothingNew : ReadStatus::kLost;
  if (state_.status == ReadStatus::kLost) return state_;
  poll_all();
  if (gone_)
    state_.status = ReadStatus::kLost;
  else if (state_.status == ReadStatus::kNothingNew && reader_.malformed_in_a_row() >= kPlaneMostMalformed)
    state_.status = ReadStatus::kGarbled;
  return state_;
}

std::array<float, 2> PlanarDevice::torques_for(const Vec3& force_n) const noexcept {
  if (!pose_ || clock_.now_ns() - state_.packet_ns > kPlaneStaleNs || !is_finite(force_n)) return {};
  Eigen::Vector2d torques = pose_->mm_per_rad.transpose() * Eigen::Vector2d(force_n.x(), force_n.y());
  const double largest = torques.cwiseAbs().maxCoeff();
  if (largest > options_.torque_cap_n_mm) torques *= options_.torque_cap_n_mm / largest;
  if (!torques.allFinite()) return {};
  constexpr double kMmPerM = 1e3;
  return {static_cast<float>(torques.x() / kMmPerM), static_cast<float>(torques.y() / kMmPerM)};
}

void PlanarDevice::send(GovernedForce force) noexcept {
  if (!open_ || gone_) return;
  const std::int64_t now_ns = clock_.now_ns();
  const std::array<float, 2> torques = torques_for(force.newtons());
  const bool zero = torques[0] == 0.0F && torques[1] == 0.0F;
  const bool force_ends = zero && !sent_zero_;
  if (awaiting_ && !force_ends && now_ns - sent_ns_ < kPlaneWakeNs) return;
  reader_.begin();
  link_->submit(zero ? zero_.span() : encoded_torques(torques).span());
  awaiting_ = true;
  sent_zero_ = zero;
  sent_ns_ = now_ns;
}

// Another thread's: touches nothing but the link and what the constructor made.
bool PlanarDevice::cut_force() noexcept {
  return link_->submit(zero_.span());
}

}  // namespace palpate::device
