#include "device/haply/planar_device.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <palpate/result.h>
#include "device/interface/driver_options.h"
#include "device/links/tty_link.h"
#include "toolkit/core/bytes.h"
#include "toolkit/core/messages.h"

namespace palpate::device {
namespace {

// Least sine of the angle between the two bars: there a motor's torque gives twenty times the force it gives
// with perpendicular bars.
constexpr double kMinSine = 0.05;

constexpr std::uint8_t kSetUp = 1, kTorques = 2;
constexpr std::uint8_t kAddress = PlanarFormat::kStart;
constexpr std::uint8_t kBothPorts = 3;  // one bit each
// Cranks turn less than once from their set-up pose.
constexpr float kMaxDeg = 720.0F;

constexpr PlanarModel kSecond{
    "2DIY, generation 2", {70.0, 90.0, 0.0}, {241.0F, -61.0F}, 10752.0F, {0, 1}, {0, 1}};
constexpr PlanarModel kThird{
    "2DIY, generation 3", {70.0, 90.0, 38.0}, {168.0F, 12.0F}, 4880.0F, {1, 1}, {1, 1}};

void add_float(CommandBytes& command, float value) noexcept {
  ByteWriter(std::span(command.bytes).subspan(command.size)).single(value);
  command.size += sizeof value;
}

bool can_be(float degrees) noexcept {
  return std::isfinite(degrees) && std::abs(degrees) <= kMaxDeg;
}

}  // namespace

std::optional<PantographPose> pantograph_pose(const PantographGeometry& geometry,
                                              const std::array<double, 2>& angles) noexcept {
  using Eigen::Vector2d;
  const double l = geometry.crank_mm, bar = geometry.bar_mm;
  const Vector2d unit_1(std::cos(angles[0]), std::sin(angles[0])),
      unit_2(std::cos(angles[1]), std::sin(angles[1]));
  const Vector2d a = l * unit_1, b = Vector2d(geometry.between_mm, 0.0) + l * unit_2;
  const Vector2d half = 0.5 * (b - a);
  const double height_sq = bar * bar - half.squaredNorm();
  if (!(height_sq > 0.0) || !(half.norm() > 0.0)) return std::nullopt;
  PantographPose pose;
  pose.position_mm = a + half + std::sqrt(height_sq) / half.norm() * Vector2d(-half.y(), half.x());
  // Bars keep their length: (p - a) . dp = (p - a) . da, and likewise for b.
  const Vector2d along_1 = pose.position_mm - a, along_2 = pose.position_mm - b;
  const double across = along_1.x() * along_2.y() - along_1.y() * along_2.x();
  if (!(std::abs(across) >= kMinSine * bar * bar)) return std::nullopt;
  const double push_1 = along_1.dot(l * Vector2d(-unit_1.y(), unit_1.x()));
  const double push_2 = along_2.dot(l * Vector2d(-unit_2.y(), unit_2.x()));
  pose.mm_per_rad.col(0) = push_1 / across * Vector2d(along_2.y(), -along_2.x());
  pose.mm_per_rad.col(1) = push_2 / across * Vector2d(-along_1.y(), along_1.x());
  return pose;
}

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

CommandBytes encoded_release() noexcept {
  const CommandBytes zero = encoded_torques({});
  CommandBytes all;
  while (all.size + 1 + zero.size <= CommandBytes::kMost) {
    if (all.size > 0) all.bytes[all.size++] = 0;
    std::copy_n(zero.bytes.begin(), zero.size, all.bytes.begin() + static_cast<std::ptrdiff_t>(all.size));
    all.size += zero.size;
  }
  return all;
}

std::optional<std::array<float, 2>> PlanarFormat::decode(
    std::span<const std::uint8_t, kBytes> bytes) noexcept {
  ByteReader in(bytes.subspan(1));
  const float second = in.single(), first = in.single();
  if (!can_be(first) || !can_be(second)) return std::nullopt;
  return std::array<float, 2>{first, second};
}

namespace {

constexpr std::size_t kPlanePollBytes = 64;
constexpr std::uint32_t kPlaneMostMalformed = 3;
constexpr std::int64_t kPlaneWakeNs = 20'000'000,
                       kPlaneStaleNs = 20'000'000;  // the governor's silence limit
constexpr useconds_t kPlaneOpenStepUs = 5000, kPlaneSetUpUs = 20000;
constexpr int kPlaneOpenWakeEvery = 20;  // polls: 0.1 s
// A board answers within two ms; after a longer quiet everything sent before is answered.
constexpr useconds_t kPlaneLookUs = 1000;
constexpr int kPlaneQuietLooks = 5, kPlaneAnswerLooks = 20, kPlaneReleaseRounds = 5;
// A reply does not name its command: one later than a quiet line allows would confirm a zero not taken by the
// board.
constexpr int kPlaneZerosAnswered = 2;
constexpr double kPlaneRateHz = 1000.0;
// Both editions reach this without aligned bars; tests walk it.
constexpr double kHalfWidthMm = 50.0, kHalfHeightMm = 30.0, kPlaneMiddleMm = 90.0;
constexpr double kHalfThicknessMm = 5.0;  // a planar device still needs a box with thickness
constexpr double kPlaneDegree = std::numbers::pi / 180.0;

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

void await_quiet_plane(Link& link) noexcept {
  std::array<std::uint8_t, kPlanePollBytes> bytes;
  for (int look = 0, quiet = 0; look < kPlaneAnswerLooks && quiet < kPlaneQuietLooks; ++look) {
    ::usleep(kPlaneLookUs);
    quiet = link.poll(bytes).size == 0 ? quiet + 1 : 0;
  }
}

constexpr const char* kPlanarWhat = "Haply 2DIY: planar, 2 degrees of freedom; no force along z";

std::string serial_lines_text() {
  std::vector<std::string> paths;
  for (const TtyFound& one : tty_lines()) paths.push_back(one.path);
  return paths.empty() ? "none is connected now" : "there are " + joined(paths);
}

std::vector<DeviceEntry> look_for_planar() {
  return {{"planar",
           kPlanarWhat,
           DeviceStatus::kMissing,
           {"name its serial line, as --device-option path=/dev/serial/by-id/NAME (" + serial_lines_text() +
            ")"}}};
}

struct RequestedPlanar {
  TtyLinkOptions line;
  const PlanarModel* model = planar_model(2);
  PlanarOptions options;
};

Status take_planar_options(RequestedPlanar& planar, const DeviceRequest& request) {
  const auto take_generation = [&planar](const std::string& value) -> Status {
    planar.model = value == "2" ? planar_model(2) : value == "3" ? planar_model(3) : nullptr;
    if (planar.model == nullptr) return Error{"generation is " + shown(value), "give 2 or 3"};
    return Done{};
  };
  PlanarOptions& options = planar.options;
  return take_options(request, "the 2DIY",
                      {text_option("path", planar.line.path),
                       {"generation", take_generation},
                       number_option("force_n", options.force_max_n, {0.0, options.force_max_n, true})});
}

Result<MadeDevice> make_planar(const DeviceRequest& request, const Clock& clock) {
  if (request.name != "planar" || !request.description.empty())
    return Error{"'planar' takes no name and no description file", "give `--device planar`"};
  RequestedPlanar planar;
  PALPATE_TRY(take_planar_options(planar, request));
  if (planar.line.path.empty())
    return Error{"the 2DIY's serial line must be named: " + serial_lines_text(),
                 "give --device-option path=/dev/serial/by-id/NAME"};
  MadeDevice made;
  auto line = std::make_unique<TtyLink>(planar.line);
  made.facts = [model = planar.model, raw = line.get()] {
    DeviceFacts facts = {{"model", model->name},
                         {"path", raw->path()},
                         {"rest_deg", fmt::format("{:g} {:g}", model->rest_deg[0], model->rest_deg[1])},
                         {"counts_per_turn", fmt::format("{:g}", model->counts_per_turn)}};
    add_link_counts(facts, raw->counters());
    return facts;
  };
  made.device = std::make_unique<PlanarDevice>(std::move(line), clock, *planar.model, planar.options);
  made.zero = [line = planar.line] {
    TtyLink link(line);
    if (!link.open()) return false;
    const bool answered = release_plane(link);
    link.close();
    return answered;
  };
  made.unproven = {
      "no 2DIY has been driven by Palpate yet: its set-up, lengths and directions are those that its "
      "maker published",
      "it has 2 degrees of freedom: its grip stays in a plane, and no force acts along z",
      "its board holds the last torque for ever: if all else fails, unplug its power"};
  return made;
}

}  // namespace

bool release_plane(Link& link) noexcept {
  const CommandBytes release = encoded_release(), zero = encoded_torques({});
  for (int round = 0; round < kPlaneReleaseRounds; ++round) {
    if (!link.submit(release.span())) return false;
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
  state_.homed = false;  // until it answers
  reader_ = {};
  pose_.reset();
  gone_ = false;
  // The first zeros end what an earlier program left: its torque, and perhaps a partial command, which takes
  // its rest from them. The board's answers to these belong to an earlier set-up.
  bool takes = link_->submit(zero_.span()) && link_->submit(zero_.span()) &&
               link_->submit(encoded_set_up(model_).span());
  if (options_.open_tries > 0) ::usleep(kPlaneSetUpUs);
  std::array<std::uint8_t, kPlanePollBytes> earlier;
  for (int i = 0; i < kMaxPolls && link_->poll(earlier).size > 0; ++i) {
  }
  takes = takes && link_->submit(zero_.span());
  if (!takes) {
    link_->close();
    return Error{"the board takes no command", "check its cable and power", name()};
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
               "check its power, and that this serial line is the 2DIY's", name()};
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
  // One count of both cranks, on the longer bars.
  limits.resolution_mm = std::numbers::sqrt2 * 2.0 * std::numbers::pi /
                         static_cast<double>(model_.counts_per_turn) * model_.geometry.bar_mm;
  limits.rate_hz = kPlaneRateHz;
  return limits;
}

void PlanarDevice::take(const std::array<float, 2>& degrees) noexcept {
  awaiting_ = false;
  state_.homed = true;
  state_.packet_ns = clock_.now_ns();
  state_.raw.keep(reader_.bytes());
  pose_ = pantograph_pose(model_.geometry, {kPlaneDegree * static_cast<double>(degrees[0]),
                                            kPlaneDegree * static_cast<double>(degrees[1])});
  // An impossible pose gives no force; the last position stays.
  state_.status = pose_ ? ReadStatus::kFresh : ReadStatus::kGarbled;
  if (!pose_) return;
  const Eigen::Vector2d place = pose_->position_mm - origin_mm();
  state_.position_mm = Vec3(place.x(), place.y(), 0.0);
}

void PlanarDevice::poll_all() noexcept {
  std::array<std::uint8_t, kPlanePollBytes> bytes;
  for (int i = 0; i < kMaxPolls; ++i) {
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

// Called by another thread: uses only the link and data fixed by the constructor.
bool PlanarDevice::cut_force() noexcept {
  return link_->submit(zero_.span());
}

void register_planar_driver(Drivers& drivers) {
  drivers.add({"planar", "serial", &look_for_planar, &make_planar});
}

}  // namespace palpate::device
