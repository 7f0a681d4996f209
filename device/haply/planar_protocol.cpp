#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "device/haply/planar_device.h"
#include "toolkit/core/bytes.h"

namespace palpate::device {
namespace {

// Least sine of the angle between the two bars: there a motor's torque gives twenty times the force it gives
// with perpendicular bars.
constexpr double kMinSine = 0.05;

/// Angle at the motor between the line to the place and the crank; nothing if out of reach.
std::optional<double> crank_turn(const PantographGeometry& geometry, double distance_mm) noexcept {
  const double l = geometry.crank_mm, bar = geometry.bar_mm;
  const double cosine = (l * l + distance_mm * distance_mm - bar * bar) / (2.0 * l * distance_mm);
  if (!(std::abs(cosine) <= 1.0)) return std::nullopt;
  return std::acos(cosine);
}

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

std::optional<std::array<double, 2>> pantograph_angles(const PantographGeometry& geometry,
                                                       const Eigen::Vector2d& place_mm) noexcept {
  const Eigen::Vector2d from_second = place_mm - Eigen::Vector2d(geometry.between_mm, 0.0);
  const std::optional<double> first = crank_turn(geometry, place_mm.norm());
  const std::optional<double> second = crank_turn(geometry, from_second.norm());
  if (!first || !second) return std::nullopt;
  return std::array<double, 2>{std::atan2(place_mm.y(), place_mm.x()) + *first,
                               std::atan2(from_second.y(), from_second.x()) - *second};
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

CommandBytes encoded_let_go() noexcept {
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

}  // namespace palpate::device
