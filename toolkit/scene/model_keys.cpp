// Scene keys for the origin and pose of points: poses, views, cleaning.
#include "toolkit/scene/model_keys.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace palpate::scene {
namespace {

// A larger deviation from unit length is a mistake: four components with three digits are within 0.002.
constexpr double kQuaternionSlack = 0.01;

Status read_rotation(const toml::node& node, Eigen::Quaterniond& to, const TomlFile& in_file) {
  PALPATE_ASSIGN(const auto q, numbers<4>(node, "rotation", in_file));
  const Eigen::Quaterniond rotation(q[0], q[1], q[2], q[3]);
  if (std::abs(rotation.norm() - 1.0) > kQuaternionSlack)
    return in_file.at(node, fmt::format("'rotation' has length {:.6g}", rotation.norm()),
                      "a rotation is a unit quaternion w, x, y, z; [1, 0, 0, 0] is none");
  // Keeps an exact 1, 0, 0, 0 for is_identity().
  to = rotation.norm() == 1.0 ? rotation : rotation.normalized();
  return Done{};
}

Result<SceneCleaningStep> read_step(const toml::table& table, const TomlFile& in_file) {
  SceneCleaningStep clean;
  clean.line = static_cast<std::int64_t>(table.source().begin.line);
  for (const auto& [key, value] : table) {
    const std::string name(key.str());
    PALPATE_ASSIGN(const std::string given, option_text(value, name, in_file));
    if (name == "step")
      clean.step.name = given;
    else
      clean.step.options.set(name, given);
  }
  if (clean.step.name.empty())
    return in_file.at(table, "a [[model.clean]] needs 'step'", "step = \"outliers\"");
  return clean;
}

Status read_steps(const toml::node& node, SceneModel& model, const TomlFile& in_file) {
  PALPATE_ASSIGN(const auto tables, tables_of(node, "model.clean", in_file));
  for (const toml::table* table : tables) {
    PALPATE_ASSIGN(SceneCleaningStep clean, read_step(*table, in_file));
    model.clean.push_back(std::move(clean));
  }
  return Done{};
}

}  // namespace

Fields pose_fields(geometry::RigidTransform& pose) {
  return {field("position_mm", pose.translation_mm, kLengthsMm),
          whole_field("rotation", pose.rotation, &read_rotation)};
}

Fields view_fields(SceneView& view) {
  Fields fields = pose_fields(view.model_from_view);
  fields.push_back(file("cloud", view.cloud).must("cloud = \"second-view.ply\""));
  return fields;
}

Field clean_field(SceneModel& model) {
  return whole_field("clean", model, &read_steps);
}

// [model.surface], [[model.region]] and [model.motion].

namespace {

constexpr const char* kBothFrictions = "give 'static' and 'dynamic', or one number for both";
constexpr const char* kFrictionMap = "friction = { image = \"mu.pfm\", tile_mm = 20, low = 0.1, high = 0.8 }";

/// `plain`, or { column = "name" } of the file.
Field or_column(Field plain, std::string& column) {
  plain.read = [read = std::move(plain.read), &column](const toml::node& node, const std::string& key,
                                                       const TomlFile& in_file) -> Status {
    const toml::table* table = node.as_table();
    if (table == nullptr || table->get("column") == nullptr) return read(node, key, in_file);
    return read_fields(*table, {field("column", column)}, "'" + key + "'", {}, in_file);
  };
  return plain;
}

template <class To>
Field share_field(std::string key, To& to) {
  return {std::move(key),
          [&to](const toml::node& node, const std::string& name, const TomlFile& in_file) -> Status {
            PALPATE_ASSIGN(const double value, number(node, name, in_file));
            if (!(value >= 0.0 && value < 1.0))
              return in_file.at(node, fmt::format("'{}' must be at least 0 and below 1", name));
            to = value;
            return Done{};
          }};
}

/// A number (both coefficients), or { static = .., dynamic = .. }.
Result<surface::Friction> friction(const toml::node& node, const TomlFile& in_file) {
  surface::Friction both;
  if (const toml::table* table = node.as_table()) {
    const Fields fields = {
        field("static", both.static_coefficient, kFrictionCoefficients).must(kBothFrictions),
        field("dynamic", both.dynamic_coefficient, kFrictionCoefficients).must(kBothFrictions)};
    PALPATE_TRY(read_fields(*table, fields, "'friction'", {}, in_file));
  } else {
    PALPATE_ASSIGN(const double one, number(node, "friction", in_file, kFrictionCoefficients));
    both = {one, one};
  }
  if (!(both.dynamic_coefficient >= 0.0) || both.dynamic_coefficient > both.static_coefficient)
    return in_file.at(node, "'friction' needs static >= dynamic >= 0");
  return both;
}

Status read_region_friction(const toml::node& node, SceneRegion& region, const TomlFile& in_file) {
  PALPATE_ASSIGN(region.friction, friction(node, in_file));
  return Done{};
}

Result<FrictionMap> friction_map(const toml::table& table, const TomlFile& in_file) {
  FrictionMap map;
  const Fields fields = {file("image", map.image).must(kFrictionMap),
                         field("tile_mm", map.tile_mm, kLengthsMm).must(kFrictionMap),
                         field("low", map.low, kFrictionCoefficients).must(kFrictionMap),
                         field("high", map.high, kFrictionCoefficients).must(kFrictionMap)};
  PALPATE_TRY(read_fields(table, fields, "a friction map", {}, in_file));
  if (!(map.low >= 0.0 && map.high >= map.low))
    return in_file.at(table, "a friction map needs 0 <= low <= high");
  return map;
}

Status read_friction(const toml::node& node, SceneModel& model, const TomlFile& in_file) {
  const toml::table* table = node.as_table();
  if (table != nullptr && table->get("image") != nullptr) {
    PALPATE_ASSIGN(model.sources.friction_map, friction_map(*table, in_file));
    return Done{};
  }
  if (table != nullptr && table->get("column") != nullptr)
    return read_fields(*table,
                       {field("column", model.sources.static_friction_column),
                        field("dynamic_column", model.sources.dynamic_friction_column)},
                       "'friction'", {}, in_file);
  PALPATE_ASSIGN(model.surface.friction, friction(node, in_file));
  return Done{};
}

Status read_axis(const toml::node& node, const std::string& key, const TomlFile& in_file, Vec3& axis) {
  PALPATE_TRY(read_value(node, key, axis, in_file));
  if (!(axis.norm() > 0.0)) return in_file.at(node, fmt::format("'{}' must not be 0", key));
  axis.normalize();
  return Done{};
}

/// Names of the texture kinds, in the order of TextureKind from kGrating on.
const std::vector<std::string>& texture_kinds() {
  static const std::vector<std::string> kKinds = {
      "a texture of kind \"grating\"", "a texture of kind \"noise\"", "a texture of kind \"image\""};
  return kKinds;
}

Status read_texture(const toml::node& node, SceneModel& model, const TomlFile& in_file) {
  PALPATE_ASSIGN(const toml::table* table, table_of(node, "model.surface.texture", in_file));
  const Fields fields = texture_fields(model);
  // The allowed keys depend on the kind, which is read first.
  const toml::node* kind = table->get("kind");
  if (kind == nullptr)
    return in_file.at(node, "[model.surface.texture] needs 'kind'", "choose from grating, noise, image");
  PALPATE_TRY(fields.front().read(*kind, "kind", in_file));
  const std::string& called = texture_kinds()[static_cast<std::size_t>(model.surface.texture.kind) -
                                              static_cast<std::size_t>(surface::TextureKind::kGrating)];
  return read_fields(*table, fields, called, called, in_file);
}

/// A region's range [low, high] on one axis; default: everything.
Field range_field(std::string key, int axis, geometry::Aabb& box) {
  box.low_mm[axis] = -std::numeric_limits<double>::infinity();
  box.high_mm[axis] = std::numeric_limits<double>::infinity();
  return {std::move(key),
          [axis, &box](const toml::node& node, const std::string& name, const TomlFile& in_file) -> Status {
            PALPATE_ASSIGN(const auto range, numbers<2>(node, name, in_file));
            if (!(range[0] <= range[1]))
              return in_file.at(node, fmt::format("'{}' must be [low, high]", name));
            box.low_mm[axis] = range[0];
            box.high_mm[axis] = range[1];
            return Done{};
          }};
}

Status read_region(const toml::table& table, SceneRegion& region, const TomlFile& in_file) {
  region.line = static_cast<std::int64_t>(table.source().begin.line);
  PALPATE_TRY(read_fields(table, region_fields(region), "a [[model.region]]", {}, in_file));
  if (!region.stiffness_n_per_mm && !region.friction && !region.deformation)
    return in_file.at(table, "a [[model.region]] changes nothing",
                      "give it stiffness_n_per_mm, friction or deformation");
  return Done{};
}

Status read_regions(const toml::node& node, SceneModel& model, const TomlFile& in_file) {
  PALPATE_ASSIGN(const auto tables, tables_of(node, "model.region", in_file));
  for (const toml::table* table : tables)
    PALPATE_TRY(read_region(*table, model.regions.emplace_back(), in_file));
  return Done{};
}

Status read_surface(const toml::node& node, SceneModel& model, const TomlFile& in_file) {
  PALPATE_ASSIGN(const toml::table* table, table_of(node, "model.surface", in_file));
  model.sources.line = static_cast<std::int64_t>(node.source().begin.line);
  return read_fields(*table, surface_fields(model), "[model.surface]", {}, in_file);
}

Status read_motion(const toml::node& node, SceneModel& model, const TomlFile& in_file) {
  PALPATE_ASSIGN(const toml::table* table, table_of(node, "model.motion", in_file));
  SceneMotion motion;
  PALPATE_TRY(read_fields(*table, motion_fields(motion), "[model.motion]", {}, in_file));
  motion.turn_rad_s *= std::numbers::pi / 180.0;
  if (motion.stop_s && !(*motion.stop_s > motion.start_s))
    return in_file.at(*table->get("stop_s"), "'stop_s' must be later than 'start_s'");
  if (motion.velocity_mm_s.isZero(0.0) && motion.turn_rad_s.isZero(0.0))
    return in_file.at(*table, "[model.motion] moves nothing",
                      "give it velocity_mm_s or turn_deg_s, or leave it out");
  if (motion.about_mm && motion.turn_rad_s.isZero(0.0))
    return in_file.at(*table->get("about_mm"), "'about_mm' does nothing without a turn",
                      "give turn_deg_s too, or leave it out");
  model.motion = motion;
  return Done{};
}

}  // namespace

Fields texture_fields(SceneModel& model) {
  using enum surface::TextureKind;
  using enum surface::TextureEffect;
  surface::Texture& texture = model.surface.texture;
  const std::vector<std::string>& kinds = texture_kinds();
  return {choice("kind", texture.kind, {{"grating", kGrating}, {"noise", kNoise}, {"image", kImage}}),
          choice("effect", texture.effect, {{"god-object", kGodObject}, {"force", kForce}}),
          field("depth_mm", texture.depth_mm, kLengthsMm).must("depth_mm = 0.1"),
          field("wavelength_mm", texture.wavelength_mm, kLengthsMm).must("wavelength_mm = 2.0"),
          Field{"axis",
                [&texture](const toml::node& node, const std::string& key, const TomlFile& in_file) {
                  return read_axis(node, key, in_file, texture.axis);
                }}
              .of({kinds[0]}),
          field("seed", texture.seed).of({kinds[1]}),
          file("image", model.sources.texture_image).must("image = \"bark.pfm\"").of({kinds[2]})};
}

Fields dent_fields(surface::Dent& dent) {
  return {field("yield_mm", dent.yield_mm, kLengthsMm).must("yield_mm = 0.5"),
          field("radius_mm", dent.radius_mm, kLengthsMm).must("radius_mm = 3.0"),
          field("rate_mm_s", dent.rate_mm_s, kSpeedsMmPerS).must("rate_mm_s = 20.0")};
}

Fields region_fields(SceneRegion& region) {
  return {range_field("x_mm", 0, region.box_mm),
          range_field("y_mm", 1, region.box_mm),
          range_field("z_mm", 2, region.box_mm),
          field("stiffness_n_per_mm", region.stiffness_n_per_mm, kStiffnessesNPerMm),
          whole_field("friction", region, &read_region_friction),
          share_field("deformation", region.deformation)};
}

Fields motion_fields(SceneMotion& motion) {
  return {field("velocity_mm_s", motion.velocity_mm_s, kSpeedsMmPerS),
          field("turn_deg_s", motion.turn_rad_s, kAngularSpeedsDegPerS),
          field("about_mm", motion.about_mm, kLengthsMm), field("start_s", motion.start_s, kTimesS),
          field("stop_s", motion.stop_s)};
}

Fields surface_fields(SceneModel& model) {
  surface::Surface& surface = model.surface;
  return {or_column(field("stiffness_n_per_mm", surface.stiffness_n_per_mm, kStiffnessesNPerMm),
                    model.sources.stiffness_column),
          whole_field("friction", model, &read_friction),
          or_column(share_field("deformation", surface.deformation), model.sources.deformation_column),
          whole_field("texture", model, &read_texture),
          inner("dent", dent_fields(surface.dent), {}, "model.surface.dent"),
          {"damping", nullptr},
          {"damping_n_s_per_mm", nullptr}};
}

Field surface_field(SceneModel& model) {
  return whole_field("surface", model, &read_surface);
}

Field regions_field(SceneModel& model) {
  return whole_field("region", model, &read_regions);
}

Field motion_field(SceneModel& model) {
  return whole_field("motion", model, &read_motion);
}

}  // namespace palpate::scene
