// Reads an arm's TOML description.
#include "device/arms/arm_description.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <numbers>

#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"
#include "toolkit/scene/toml_fields.h"

namespace palpate::device {
namespace {

using Vec2 = Eigen::Vector2d;

// Share of the linkage's lengths: nearer to stretched, the rod passes no torque and the cranks do not
// determine the forearm's angle.
constexpr double kStretched = 1e-6;
constexpr double kGravityMS2 = 9.81;  // kg, mm and m/s^2 give N*mm

/// Turns a planar linkage about z: rho outwards, z upwards, each with derivatives by B and C.
ArmPose turned(double a, double rho, const std::array<double, 2>& d_rho, double z,
               const std::array<double, 2>& d_z, const Vec3& origin_mm) noexcept {
  const double c = std::cos(a), s = std::sin(a);
  ArmPose pose;
  pose.position_mm = Vec3(rho * c, rho * s, z) - origin_mm;
  pose.mm_per_rad.col(0) = Vec3(-rho * s, rho * c, 0.0);
  for (int i = 0; i < 2; ++i) {
    const auto at = static_cast<std::size_t>(i);
    pose.mm_per_rad.col(i + 1) = Vec3(d_rho[at] * c, d_rho[at] * s, d_z[at]);
  }
  return pose;
}

ArmPose chain_pose(const ArmGeometry& geometry, const ArmAngles& angles) noexcept {
  const double shoulder = geometry.lengths_mm[0], upper = geometry.lengths_mm[1],
               fore = geometry.lengths_mm[2];
  const double cb = std::cos(angles[1]), sb = std::sin(angles[1]);
  const double cc = std::cos(angles[2]), sc = std::sin(angles[2]);
  return turned(angles[0], upper * sb + fore * sc, {upper * cb, fore * cc}, shoulder + upper * cb - fore * cc,
                {-upper * sb, fore * sc}, geometry.origin_mm);
}

// In the arm's plane crank B ends at the elbow b, crank C at e. The forearm passes through the elbow to the
// grip, and back for L4 to the rod from e. With d = b - e and the forearm's direction u, |d - L4 u| = L3
// gives the angle between d and u.
std::optional<ArmPose> five_bar_pose(const ArmGeometry& geometry, const ArmAngles& angles) noexcept {
  const auto [l0, l1, l2, l3, l4, l5] = geometry.lengths_mm;
  const Vec2 unit_b(std::cos(angles[1]), std::sin(angles[1])),
      unit_c(std::cos(angles[2]), std::sin(angles[2]));
  const Vec2 b = Vec2(0.5 * l0, 0.0) + l1 * unit_b, e = Vec2(-0.5 * l0, 0.0) + l2 * unit_c;
  const Vec2 d = b - e, from_c = b - Vec2(-0.5 * l0, 0.0);
  // The other sign lies beyond a singular position of the linkage.
  if (!(from_c.x() * l2 * unit_c.y() - from_c.y() * l2 * unit_c.x() > 0.0)) return std::nullopt;
  const double distance = d.norm();
  const double cosine = (d.squaredNorm() + l4 * l4 - l3 * l3) / (2.0 * distance * l4);
  if (!(std::abs(cosine) < 1.0 - kStretched)) return std::nullopt;
  const double forearm = std::atan2(d.y(), d.x()) - std::acos(cosine);
  const Vec2 u(std::cos(forearm), std::sin(forearm)), across(-u.y(), u.x());
  // The length of r = d - L4 u is constant: r . (dd - L4 across dforearm) = 0.
  const Vec2 rod = d - l4 * u;
  const double lever = l4 * rod.dot(across);
  const Vec2 db(-l1 * unit_b.y(), l1 * unit_b.x()), de(-l2 * unit_c.y(), l2 * unit_c.x());
  const double forearm_by_b = rod.dot(db) / lever, forearm_by_c = -rod.dot(de) / lever;
  const Vec2 by_b = db + l5 * forearm_by_b * across, by_c = l5 * forearm_by_c * across;
  const Vec2 grip = b + l5 * u;
  return turned(angles[0], grip.x(), {by_b.x(), by_c.x()}, grip.y(), {by_b.y(), by_c.y()},
                geometry.origin_mm);
}

using scene::Field;
using scene::field;
using scene::Fields;
using scene::kAboveZero;
using scene::kNotNegative;
using scene::TomlFile;

constexpr std::uint64_t kMaxDescriptionBytes = 1U << 16U;  // shipped ones have 2000
// Current of the strongest amplifiers in a published build; more is a typing error.
constexpr NumberRange kAmps{0.0, 6.0, true};
constexpr NumberRange kReportBytes{0.0, 64.0, false};
// Body angle per count: published arms have 2e-4 rad. A factor of 1000 either way is implausible.
constexpr double kMinStepRad = 2e-7, kMaxStepRad = 2e-1;
constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kRateHz = 1000.0;  // USB full speed: one report per frame

/// Three numbers in a range, one per joint.
Field joints(std::string key, std::array<double, 3>& into, const NumberRange& range = kAboveZero) {
  return {std::move(key),
          [&into, range](const toml::node& node, const std::string& name, const TomlFile& in_file) -> Status {
            const toml::array* array = node.as_array();
            if (array == nullptr || array->size() != into.size())
              return in_file.at(node, fmt::format("'{}' must be a list of 3 numbers", name),
                                "one for each of the joints A, B, C");
            for (std::size_t i = 0; i < into.size(); ++i) {
              PALPATE_ASSIGN(into[i], scene::number(*array->get(i), name, in_file, range));
            }
            return Done{};
          }};
}

Field signs(std::array<double, 3>& into) {
  return {"signs",
          [&into](const toml::node& node, const std::string& name, const TomlFile& in_file) -> Status {
            PALPATE_TRY(joints(name, into, scene::kAnyNumber).read(node, name, in_file));
            for (const double sign : into)
              if (sign != 1.0 && sign != -1.0)
                return in_file.at(node, "'signs' are 1 or -1",
                                  "-1 where the motor turns against the body, as signs = [1, -1, 1]");
            return Done{};
          }};
}

Fields link_fields(ArmDescription& arm) {
  return {scene::choice(
              "form", arm.form,
              {{"report8", ArmForm::kReport8}, {"report14", ArmForm::kReport14}, {"text", ArmForm::kText}})
              .must("form = \"report8\", \"report14\" or \"text\""),
          field("vendor", arm.hid.vendor),
          field("product", arm.hid.product),
          field("usage_page", arm.hid.usage_page),
          field("usage", arm.hid.usage),
          field("serial", arm.hid.serial),
          field("path", arm.hid.path),
          field("report_bytes", arm.report_bytes),
          field("serial_line", arm.serial_line),
          field("model", arm.model)};
}

Status check_link(const toml::node& node, const ArmDescription& arm, const TomlFile& in_file) {
  const toml::table& table = *node.as_table();
  const bool text = arm.form == ArmForm::kText;
  const auto refuse = [&](std::initializer_list<const char*> keys, const char* of) -> Status {
    for (const char* key : keys)
      if (const toml::node* given = table.get(key))
        return in_file.at(*given, fmt::format("'{}' does nothing here", key),
                          fmt::format("it is of {}: leave it out", of));
    return Done{};
  };
  if (text) {
    PALPATE_TRY(refuse({"vendor", "product", "usage_page", "usage", "serial", "path", "report_bytes"},
                       "form = \"report8\" or \"report14\""));
    if (arm.serial_line.empty())
      return in_file.at(node, "an arm that speaks text needs 'serial_line'",
                        "serial_line = \"/dev/serial/by-id/usb-Teensyduino_USB_Serial_*\"");
    return Done{};
  }
  PALPATE_TRY(refuse({"serial_line", "model"}, "form = \"text\""));
  if (arm.hid.vendor == 0 || arm.hid.product == 0)
    return in_file.at(node, "an arm that sends reports needs 'vendor' and 'product'",
                      "as `lsusb` shows them: vendor = 0x1234, product = 0x0006");
  const std::size_t size = report_size(arm.form);
  if (arm.report_bytes != 0 && (arm.report_bytes < size || arm.report_bytes > RawPacket::kMost))
    return in_file.at(node, fmt::format("'report_bytes' is {}", arm.report_bytes),
                      fmt::format("give {} to {}, or leave it out for {}", size, RawPacket::kMost, size));
  return Done{};
}

Status read_link(const toml::node& node, ArmDescription& arm, const TomlFile& in_file) {
  PALPATE_ASSIGN(const toml::table* table, scene::table_of(node, "link", in_file));
  PALPATE_TRY(scene::read_fields(*table, link_fields(arm), "[link]", {}, in_file));
  return check_link(node, arm, in_file);
}

Status read_lengths(const toml::node& node, ArmDescription& arm, const TomlFile& in_file) {
  const bool chain = arm.geometry.linkage == ArmLinkage::kChain;
  const std::size_t wanted = chain ? 3 : 6;
  const toml::array* array = node.as_array();
  if (array == nullptr || array->size() != wanted)
    return in_file.at(node, fmt::format("'lengths_mm' must be a list of {} numbers", wanted),
                      chain ? "height of the shoulder, upper arm, forearm"
                            : "between the cranks, crank B, crank C, rod, elbow to rod, forearm");
  for (std::size_t i = 0; i < wanted; ++i) {
    PALPATE_ASSIGN(arm.geometry.lengths_mm[i],
                   scene::number(*array->get(i), "lengths_mm", in_file, i == 0 ? kNotNegative : kAboveZero));
  }
  return Done{};
}

Status read_kinematics(const toml::node& node, ArmDescription& arm, const TomlFile& in_file) {
  PALPATE_ASSIGN(const toml::table* table, scene::table_of(node, "kinematics", in_file));
  const Fields fields = {
      scene::choice("linkage", arm.geometry.linkage,
                    {{"chain", ArmLinkage::kChain}, {"five-bar", ArmLinkage::kFiveBar}})
          .must("linkage = \"chain\" or \"five-bar\""),
      Field{"lengths_mm", [&arm](const toml::node& lengths, const std::string&,
                                 const TomlFile& file) { return read_lengths(lengths, arm, file); }}
          .must("lengths_mm = [80, 205, 245]"),
      field("origin_mm", arm.geometry.origin_mm).must("origin_mm = [220, 0, 80]"),
      joints("capstan_mm", arm.capstan_mm).must("capstan_mm = [10, 10, 10], the motors' diameters"),
      joints("body_mm", arm.body_mm).must("body_mm = [160, 120, 120], the driven diameters"),
      joints("counts_per_turn", arm.counts_per_turn).must("counts_per_turn = [2000, 2000, 2000]"),
      signs(arm.sign).must("signs = [1, -1, 1]")};
  PALPATE_TRY(scene::read_fields(*table, fields, "[kinematics]", {}, in_file));
  for (std::size_t i = 0; i < arm.sign.size(); ++i) {
    const double step = std::abs(arm.rad_per_count(i));
    if (!(step >= kMinStepRad && step <= kMaxStepRad))
      return in_file.at(node, fmt::format("one count would turn joint {} by {:.3g} rad", "ABC"[i], step),
                        "check capstan_mm, body_mm and counts_per_turn");
  }
  return Done{};
}

Status read_rest(const toml::node& node, ArmDescription& arm, const TomlFile& in_file) {
  PALPATE_ASSIGN(const toml::table* table, scene::table_of(node, "rest", in_file));
  std::array<double, 3> angles{};
  const Fields fields = {
      scene::choice(
          "when", arm.rest,
          {{"start", ArmRest::kStart}, {"button", ArmRest::kButton}, {"power-on", ArmRest::kPowerOn}})
          .must("when = \"start\", \"button\" or \"power-on\""),
      joints("counts", arm.rest_counts, scene::kAnyNumber), joints("angles_deg", angles, scene::kAnyNumber),
      field("in_firmware", arm.rest_in_firmware)};
  PALPATE_TRY(scene::read_fields(*table, fields, "[rest]", {}, in_file));
  const bool by_angles = table->get("angles_deg") != nullptr;
  if (by_angles == (table->get("counts") != nullptr))
    return in_file.at(node, "[rest] needs either 'counts' or 'angles_deg'",
                      "angles_deg = [0, 0, 90]: the angles A, B, C in the rest pose");
  if (by_angles)
    for (std::size_t i = 0; i < angles.size(); ++i)
      arm.rest_counts[i] = angles[i] * kDegree / arm.rad_per_count(i);
  if ((arm.rest == ArmRest::kButton || arm.rest_in_firmware) && arm.form != ArmForm::kReport14)
    return in_file.at(node,
                      "only arms of form = \"report14\" have a calibration button and set their counters",
                      "write when = \"start\", without in_firmware");
  for (const double counts : arm.rest_counts)
    if (arm.rest_in_firmware && std::abs(counts) > std::numeric_limits<std::int16_t>::max())
      return in_file.at(node, "the rest pose has counts beyond 16 bits, which the arm cannot be told",
                        "leave in_firmware out");
  if (!arm_pose(arm.geometry, arm.angles_of(arm.rest_counts)))
    return in_file.at(node, "the linkage cannot be in this rest pose",
                      "check lengths, signs and diameters of [kinematics], and the counts here");
  return Done{};
}

Status read_motors(const toml::node& node, ArmDescription& arm, const TomlFile& in_file) {
  PALPATE_ASSIGN(const toml::table* table, scene::table_of(node, "motors", in_file));
  const Fields fields = {
      joints("torque_n_mm_per_a", arm.torque_n_mm_per_a).must("torque_n_mm_per_a = [25.9, 25.9, 25.9]"),
      field("current_cap_a", arm.current_cap_a, kAmps, "2 is what the usual amplifiers bear")
          .must("current_cap_a = 2"),
      field("off_after_s", arm.amplifiers_off_after_s, kNotNegative)};
  return scene::read_fields(*table, fields, "[motors]", {}, in_file);
}

Status read_limits(const toml::node& node, ArmDescription& arm, const TomlFile& in_file) {
  PALPATE_ASSIGN(const toml::table* table, scene::table_of(node, "limits", in_file));
  DeviceLimits& limits = arm.limits;
  geometry::Aabb& box = limits.workspace_mm;
  const Fields fields = {field("force_n", limits.force_max_n, kAboveZero).must("force_n = 5"),
                         field("stiffness_n_per_mm", limits.stiffness_max_n_per_mm, kNotNegative),
                         field("damping_n_s_per_mm", limits.damping_max_n_s_per_mm, kNotNegative),
                         field("workspace_low_mm", box.low_mm).must("workspace_low_mm = [-100, -100, -100]"),
                         field("workspace_high_mm", box.high_mm).must("workspace_high_mm = [100, 100, 100]"),
                         scene::choice("shape", limits.workspace_shape,
                                       {{"box", WorkspaceShape::kBox},
                                        {"ellipsoid", WorkspaceShape::kEllipsoid},
                                        {"cylinder", WorkspaceShape::kCylinder}})};
  PALPATE_TRY(scene::read_fields(*table, fields, "[limits]", {}, in_file));
  if (!(box.low_mm.array() < box.high_mm.array()).all())
    return in_file.at(node, "the workspace is empty", "workspace_low_mm must lie below workspace_high_mm");
  return Done{};
}

Status read_weight(const toml::node& node, ArmDescription& arm, const TomlFile& in_file) {
  PALPATE_ASSIGN(const toml::table* table, scene::table_of(node, "weight", in_file));
  const Fields fields = {field("held", arm.weight).must("held = false"),
                         field("upper_kg", arm.masses.upper_kg, kNotNegative).must("upper_kg = 0.17"),
                         field("upper_mm", arm.masses.upper_mm, kNotNegative).must("upper_mm = 51"),
                         field("fore_kg", arm.masses.fore_kg, kNotNegative).must("fore_kg = 0.11"),
                         field("fore_mm", arm.masses.fore_mm, kNotNegative).must("fore_mm = 91")};
  PALPATE_TRY(scene::read_fields(*table, fields, "[weight]", {}, in_file));
  if (arm.weight && arm.geometry.linkage != ArmLinkage::kChain)
    return in_file.at(node, "only a chain's weight can be held", "write held = false");
  return Done{};
}

Field table_field(std::string key, ArmDescription& arm,
                  Status (*read)(const toml::node&, ArmDescription&, const TomlFile&)) {
  return {std::move(key), [&arm, read](const toml::node& node, const std::string&, const TomlFile& in_file) {
            return read(node, arm, in_file);
          }};
}

/// In reading order: the rest pose needs link and kinematics.
Fields description_fields(ArmDescription& arm) {
  return {
      field("name", arm.name).must("name = \"my-arm\""),
      field("what", arm.what),
      field("notes", arm.notes),
      table_field("link", arm, &read_link).must("[link] with form = \"report8\""),
      table_field("kinematics", arm, &read_kinematics).must("[kinematics] with linkage = \"chain\""),
      table_field("motors", arm, &read_motors).must("[motors] with current_cap_a = 2"),
      table_field("rest", arm, &read_rest).must("[rest] with when = \"start\""),
      table_field("limits", arm, &read_limits).must("[limits] with force_n = 5"),
      table_field("weight", arm, &read_weight),
      scene::choice("button", arm.button, {{"none", ArmButton::kNone}, {"encoder-d", ArmButton::kEncoderD}})};
}

Result<ArmDescription> arm_of(const toml::table& root, const std::string& file) {
  ArmDescription arm;
  PALPATE_TRY(scene::read_fields(root, description_fields(arm), "the description", {}, TomlFile{file}));
  if (arm.what.empty()) arm.what = arm.name;
  arm.limits.rate_hz = kRateHz;
  std::array<double, 3> steps{};
  for (std::size_t i = 0; i < steps.size(); ++i) steps[i] = std::abs(arm.rad_per_count(i));
  arm.limits.resolution_mm = arm_resolution_mm(arm.geometry, steps);
  return arm;
}

std::filesystem::path users_folder() {
  if (const char* config = std::getenv("XDG_CONFIG_HOME"); config != nullptr && *config != 0)
    return std::filesystem::path(config) / "palpate" / "devices";
  if (const char* home = std::getenv("HOME"); home != nullptr && *home != 0)
    return std::filesystem::path(home) / ".config" / "palpate" / "devices";
  return {};
}

}  // namespace

std::optional<ArmPose> arm_pose(const ArmGeometry& geometry, const ArmAngles& angles) noexcept {
  std::optional<ArmPose> pose =
      geometry.linkage == ArmLinkage::kChain ? chain_pose(geometry, angles) : five_bar_pose(geometry, angles);
  if (pose && !(is_finite(pose->position_mm) && pose->mm_per_rad.allFinite())) pose.reset();
  return pose;
}

Vec3 weight_torques_n_mm(const ArmGeometry& geometry, const ArmMasses& masses,
                         const ArmAngles& angles) noexcept {
  if (geometry.linkage != ArmLinkage::kChain) return Vec3::Zero();
  const double upper = masses.upper_kg * masses.upper_mm + masses.fore_kg * geometry.lengths_mm[1];
  return {0.0, -kGravityMS2 * upper * std::sin(angles[1]),
          kGravityMS2 * masses.fore_kg * masses.fore_mm * std::sin(angles[2])};
}

double arm_resolution_mm(const ArmGeometry& geometry, const std::array<double, 3>& step_rad) noexcept {
  const auto& lengths = geometry.lengths_mm;
  const bool chain = geometry.linkage == ArmLinkage::kChain;
  const double reach = std::hypot(geometry.origin_mm.x(), geometry.origin_mm.y());
  // A turn of crank C moves the rod's end by L2 per rad, and the grip by L5 / L4 times that.
  const double by_b = lengths[1], by_c = chain ? lengths[2] : lengths[5] * lengths[2] / lengths[4];
  return Vec3(reach * step_rad[0], by_b * step_rad[1], by_c * step_rad[2]).norm();
}

double ArmDescription::rad_per_count(std::size_t joint) const noexcept {
  return sign[joint] * 2.0 * std::numbers::pi / counts_per_turn[joint] * capstan_mm[joint] / body_mm[joint];
}

// The transmission ratio of the angles also applies to the torques.
double ArmDescription::ma_per_n_mm(std::size_t joint) const noexcept {
  constexpr double kMaPerA = 1e3;
  return sign[joint] * capstan_mm[joint] / body_mm[joint] / torque_n_mm_per_a[joint] * kMaPerA;
}

ArmAngles ArmDescription::angles_of(const std::array<double, 3>& counts) const noexcept {
  ArmAngles angles{};
  for (std::size_t i = 0; i < angles.size(); ++i) angles[i] = counts[i] * rad_per_count(i);
  return angles;
}

Result<ArmDescription> parse_arm_description(std::string_view text, const std::string& name) {
  try {
    return arm_of(toml::parse(text, name), name);
  } catch (const toml::parse_error& error) {
    return Error{fmt::format("{} (column {})", error.description(), error.source().begin.column),
                 "the file must be TOML; those in share/palpate/devices are examples", name,
                 static_cast<std::int64_t>(error.source().begin.line)};
  }
}

Result<ArmDescription> read_arm_description(const std::string& path) {
  PALPATE_ASSIGN(const std::string text, read_file(path, kMaxDescriptionBytes));
  if (const Result<std::size_t> mark = byte_order_mark(text); !mark) return Error(mark.error()).in_file(path);
  return parse_arm_description(text, path);
}

std::vector<KnownArm> known_arms() {
  std::vector<KnownArm> all;
  const std::filesystem::path folder = users_folder();
  std::error_code wrong;  // folder absent or unreadable: no user descriptions
  std::filesystem::directory_iterator at;
  if (!folder.empty()) at = std::filesystem::directory_iterator(folder, wrong);
  for (; !wrong && at != std::filesystem::directory_iterator(); at.increment(wrong))
    if (at->path().extension() == ".toml")
      all.push_back({at->path().stem().string(), at->path().string(), {}});
  for (const KnownArm& one : built_in_arms())
    if (std::none_of(all.begin(), all.end(), [&](const KnownArm& other) { return other.name == one.name; }))
      all.push_back(one);
  std::sort(all.begin(), all.end(), [](const KnownArm& a, const KnownArm& b) { return a.name < b.name; });
  return all;
}

Result<ArmDescription> find_arm(const std::string& name) {
  const std::vector<KnownArm> known = known_arms();
  for (const KnownArm& one : known)
    if (one.name == name)
      return one.file.empty() ? parse_arm_description(one.text, name + ".toml")
                              : read_arm_description(one.file);
  return Error{"there is no arm " + shown(name),
               did_you_mean(name, names_of(known), "choose from " + joined(names_of(known)))};
}

}  // namespace palpate::device
