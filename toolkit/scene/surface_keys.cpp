// [model.surface], [[model.region]] and [model.motion].
#include <filesystem>
#include <limits>
#include <numbers>

#include "toolkit/scene/toml_reading.h"

namespace palpate::scene {
namespace {

/// { column = "name" }: the column's name; empty where the value is something else.
Result<std::string> column_of(const toml::node& node, const std::string& key, const InFile& in_file) {
  const toml::table* table = node.as_table();
  if (table == nullptr || table->get("column") == nullptr) return std::string();
  if (const Status keys = check_keys(*table, {"column"}, {}, fmt::format("'{}'", key), in_file); !keys)
    return keys.error();
  return text(*table->get("column"), key + ".column", in_file);
}

/// A path in a scene is relative to the scene file.
Result<std::string> file_of(const toml::node& node, const std::string& key, const InFile& in_file) {
  const Result<std::string> name = text(node, key, in_file);
  if (!name) return name;
  return (std::filesystem::path(in_file.file).parent_path() / *name).lexically_normal().string();
}

Result<double> positive(const toml::node& node, const std::string& key, const InFile& in_file) {
  const Result<double> value = number(node, key, in_file);
  if (value && !(*value > 0.0)) return in_file.at(node, fmt::format("'{}' must be above 0", key));
  return value;
}

Result<double> share(const toml::node& node, const std::string& key, const InFile& in_file) {
  const Result<double> value = number(node, key, in_file);
  if (value && !(*value >= 0.0 && *value < 1.0))
    return in_file.at(node, fmt::format("'{}' must be at least 0 and below 1", key));
  return value;
}

/// A number (both coefficients), or { static = .., dynamic = .. }.
Result<surface::Friction> friction(const toml::node& node, const InFile& in_file) {
  surface::Friction both;
  if (const toml::table* table = node.as_table()) {
    if (const Status keys = check_keys(*table, {"static", "dynamic"}, {}, "'friction'", in_file); !keys)
      return keys.error();
    const toml::node *rest = table->get("static"), *slip = table->get("dynamic");
    if (rest == nullptr || slip == nullptr)
      return in_file.at(node, "'friction' needs 'static' and 'dynamic'", "or one number for both");
    const Result<double> static_value = number(*rest, "friction.static", in_file);
    if (!static_value) return static_value.error();
    const Result<double> dynamic_value = number(*slip, "friction.dynamic", in_file);
    if (!dynamic_value) return dynamic_value.error();
    both = {*static_value, *dynamic_value};
  } else {
    const Result<double> one = number(node, "friction", in_file);
    if (!one) return one.error();
    both = {*one, *one};
  }
  if (!(both.dynamic_coefficient >= 0.0) || both.dynamic_coefficient > both.static_coefficient)
    return in_file.at(node, "'friction' needs static >= dynamic >= 0");
  return both;
}

Result<FrictionMap> friction_map(const toml::table& table, const InFile& in_file) {
  if (const Status keys = check_keys(table, {"image", "tile_mm", "low", "high"}, {}, "'friction'", in_file);
      !keys)
    return keys.error();
  for (const char* key : {"image", "tile_mm", "low", "high"})
    if (table.get(key) == nullptr)
      return in_file.at(table, fmt::format("a friction map needs '{}'", key),
                        "friction = { image = \"mu.pfm\", tile_mm = 20, low = 0.1, high = 0.8 }");
  FrictionMap map;
  const Result<std::string> image = file_of(*table.get("image"), "friction.image", in_file);
  if (!image) return image.error();
  const Result<double> tile = positive(*table.get("tile_mm"), "friction.tile_mm", in_file);
  if (!tile) return tile.error();
  const Result<double> low = number(*table.get("low"), "friction.low", in_file);
  if (!low) return low.error();
  const Result<double> high = number(*table.get("high"), "friction.high", in_file);
  if (!high) return high.error();
  if (!(*low >= 0.0 && *high >= *low)) return in_file.at(table, "a friction map needs 0 <= low <= high");
  return FrictionMap{*image, *tile, *low, *high};
}

Status read_friction(const toml::node& node, SceneModel& model, const InFile& in_file) {
  if (const toml::table* table = node.as_table()) {
    if (table->get("image") != nullptr) {
      const Result<FrictionMap> map = friction_map(*table, in_file);
      if (!map) return map.error();
      model.sources.friction_map = *map;
      return Done{};
    }
    if (table->get("column") != nullptr) {
      if (const Status keys = check_keys(*table, {"column", "dynamic_column"}, {}, "'friction'", in_file);
          !keys)
        return keys.error();
      const Result<std::string> name = text(*table->get("column"), "friction.column", in_file);
      if (!name) return name.error();
      model.sources.static_friction_column = *name;
      if (const toml::node* dynamic = table->get("dynamic_column")) {
        const Result<std::string> second = text(*dynamic, "friction.dynamic_column", in_file);
        if (!second) return second.error();
        model.sources.dynamic_friction_column = *second;
      }
      return Done{};
    }
  }
  const Result<surface::Friction> value = friction(node, in_file);
  if (!value) return value.error();
  model.surface.friction = *value;
  return Done{};
}

/// The one of `choices` that the text names.
template <class T, std::size_t n>
Result<T> choice(const toml::node& node, const std::string& key,
                 const std::array<std::pair<const char*, T>, n>& choices, const InFile& in_file) {
  const Result<std::string> name = text(node, key, in_file);
  if (!name) return name.error();
  std::vector<std::string> known;
  for (const auto& [word, value] : choices) {
    if (*name == word) return value;
    known.emplace_back(word);
  }
  return in_file.at(node, fmt::format("there is no {} {}", key, shown(*name)),
                    did_you_mean(*name, known, "choose from " + joined(known)));
}

/// What a texture has beside kind, effect, depth_mm and wavelength_mm, in the order of TextureKind from
/// kGrating on.
const std::vector<KindKeys>& texture_kinds() {
  static const std::vector<KindKeys> kKinds = {{"a texture of kind \"grating\"", {"axis"}},
                                               {"a texture of kind \"noise\"", {"seed"}},
                                               {"a texture of kind \"image\"", {"image"}}};
  return kKinds;
}

Status read_texture(const toml::node& node, SceneModel& model, const InFile& in_file) {
  using enum surface::TextureKind;
  const Result<const toml::table*> table = table_of(node, "model.surface.texture", in_file);
  if (!table) return table.error();
  if ((*table)->get("kind") == nullptr)
    return in_file.at(node, "[model.surface.texture] needs 'kind'", "choose from grating, noise, image");
  surface::Texture& t = model.surface.texture;
  const auto kind = choice<surface::TextureKind, 3>(
      *(*table)->get("kind"), "kind", {{{"grating", kGrating}, {"noise", kNoise}, {"image", kImage}}},
      in_file);
  if (!kind) return kind.error();
  t.kind = *kind;
  const auto row = static_cast<std::size_t>(*kind) - static_cast<std::size_t>(kGrating);
  if (const Status keys =
          check_keys(**table, {"kind", "effect", "depth_mm", "wavelength_mm"}, texture_kinds(), row, in_file);
      !keys)
    return keys.error();
  for (const char* key : {"depth_mm", "wavelength_mm"})
    if ((*table)->get(key) == nullptr)
      return in_file.at(node, fmt::format("[model.surface.texture] needs '{}'", key));
  if (const toml::node* effect = (*table)->get("effect")) {
    const auto value = choice<surface::TextureEffect, 2>(
        *effect, "effect",
        {{{"god-object", surface::TextureEffect::kGodObject}, {"force", surface::TextureEffect::kForce}}},
        in_file);
    if (!value) return value.error();
    t.effect = *value;
  }
  const Result<double> depth = positive(*(*table)->get("depth_mm"), "depth_mm", in_file);
  if (!depth) return depth.error();
  const Result<double> wavelength = positive(*(*table)->get("wavelength_mm"), "wavelength_mm", in_file);
  if (!wavelength) return wavelength.error();
  t.depth_mm = *depth;
  t.wavelength_mm = *wavelength;
  if (const toml::node* axis = (*table)->get("axis")) {
    const auto v = numbers<3>(*axis, "axis", in_file);
    if (!v) return v.error();
    t.axis = Vec3((*v)[0], (*v)[1], (*v)[2]);
    if (!(t.axis.norm() > 0.0)) return in_file.at(*axis, "'axis' must not be 0");
    t.axis.normalize();
  }
  if (const toml::node* seed = (*table)->get("seed")) {
    const auto value = seed->value_exact<std::int64_t>();
    if (!value || *value < 0) return in_file.at(*seed, "'seed' must be a whole number, 0 or more");
    t.seed = static_cast<std::uint64_t>(*value);
  }
  if (t.kind != kImage) return Done{};
  const toml::node* image = (*table)->get("image");
  if (image == nullptr)
    return in_file.at(node, "a texture of kind \"image\" needs 'image'", "image = \"bark.pfm\"");
  const Result<std::string> file = file_of(*image, "image", in_file);
  if (!file) return file.error();
  model.sources.texture_image = *file;
  return Done{};
}

Status read_dent(const toml::node& node, SceneModel& model, const InFile& in_file) {
  const Result<const toml::table*> table = table_of(node, "model.surface.dent", in_file);
  if (!table) return table.error();
  if (const Status keys =
          check_keys(**table, {"yield_mm", "radius_mm", "rate_mm_s"}, {}, "[model.surface.dent]", in_file);
      !keys)
    return keys.error();
  for (const auto& [key, value] : {std::pair{"yield_mm", &model.surface.dent.yield_mm},
                                   std::pair{"radius_mm", &model.surface.dent.radius_mm},
                                   std::pair{"rate_mm_s", &model.surface.dent.rate_mm_s}}) {
    const toml::node* entry = (*table)->get(key);
    if (entry == nullptr) return in_file.at(node, fmt::format("[model.surface.dent] needs '{}'", key));
    const Result<double> read = positive(*entry, key, in_file);
    if (!read) return read.error();
    *value = *read;
  }
  return Done{};
}

/// A range [low, high] of one axis of a region; without the key: everything.
Status read_range(const toml::table& table, const char* key, int axis, geometry::Aabb& box,
                  const InFile& in_file) {
  box.low_mm[axis] = -std::numeric_limits<double>::infinity();
  box.high_mm[axis] = std::numeric_limits<double>::infinity();
  const toml::node* node = table.get(key);
  if (node == nullptr) return Done{};
  const auto range = numbers<2>(*node, key, in_file);
  if (!range) return range.error();
  if (!((*range)[0] <= (*range)[1])) return in_file.at(*node, fmt::format("'{}' must be [low, high]", key));
  box.low_mm[axis] = (*range)[0];
  box.high_mm[axis] = (*range)[1];
  return Done{};
}

Result<SceneRegion> read_region(const toml::table& table, const InFile& in_file) {
  if (const Status keys =
          check_keys(table, {"x_mm", "y_mm", "z_mm", "stiffness_n_per_mm", "friction", "deformation"}, {},
                     "a [[model.region]]", in_file);
      !keys)
    return keys.error();
  SceneRegion region;
  region.line = static_cast<std::int64_t>(table.source().begin.line);
  int axis = 0;
  for (const char* key : {"x_mm", "y_mm", "z_mm"})
    if (const Status range = read_range(table, key, axis++, region.box_mm, in_file); !range)
      return range.error();
  if (const toml::node* node = table.get("stiffness_n_per_mm")) {
    const Result<double> value = positive(*node, "stiffness_n_per_mm", in_file);
    if (!value) return value.error();
    region.stiffness_n_per_mm = *value;
  }
  if (const toml::node* node = table.get("friction")) {
    const Result<surface::Friction> value = friction(*node, in_file);
    if (!value) return value.error();
    region.friction = *value;
  }
  if (const toml::node* node = table.get("deformation")) {
    const Result<double> value = share(*node, "deformation", in_file);
    if (!value) return value.error();
    region.deformation = *value;
  }
  if (!region.stiffness_n_per_mm && !region.friction && !region.deformation)
    return in_file.at(table, "a [[model.region]] changes nothing",
                      "give it stiffness_n_per_mm, friction or deformation");
  return region;
}

}  // namespace

Status read_surface(const toml::table& model_table, SceneModel& model, const InFile& in_file) {
  const toml::node* node = model_table.get("surface");
  if (node == nullptr) return Done{};
  const Result<const toml::table*> table = table_of(*node, "model.surface", in_file);
  if (!table) return table.error();
  const toml::table& surface = **table;
  if (const Status keys =
          check_keys(surface, {"stiffness_n_per_mm", "friction", "deformation", "texture", "dent"},
                     {"damping", "damping_n_s_per_mm"}, "[model.surface]", in_file);
      !keys)
    return keys.error();
  model.sources.line = static_cast<std::int64_t>(node->source().begin.line);
  if (const toml::node* stiffness = surface.get("stiffness_n_per_mm")) {
    const Result<std::string> column = column_of(*stiffness, "stiffness_n_per_mm", in_file);
    if (!column) return column.error();
    model.sources.stiffness_column = *column;
    if (column->empty()) {
      const Result<double> value = positive(*stiffness, "stiffness_n_per_mm", in_file);
      if (!value) return value.error();
      model.surface.stiffness_n_per_mm = *value;
    }
  }
  if (const toml::node* rub = surface.get("friction"))
    if (const Status read = read_friction(*rub, model, in_file); !read) return read.error();
  if (const toml::node* deformation = surface.get("deformation")) {
    const Result<std::string> column = column_of(*deformation, "deformation", in_file);
    if (!column) return column.error();
    model.sources.deformation_column = *column;
    if (column->empty()) {
      const Result<double> value = share(*deformation, "deformation", in_file);
      if (!value) return value.error();
      model.surface.deformation = *value;
    }
  }
  if (const toml::node* texture = surface.get("texture"))
    if (const Status read = read_texture(*texture, model, in_file); !read) return read.error();
  if (const toml::node* dent = surface.get("dent"))
    if (const Status read = read_dent(*dent, model, in_file); !read) return read.error();
  return Done{};
}

Status read_regions(const toml::table& model_table, SceneModel& model, const InFile& in_file) {
  const Result<std::vector<const toml::table*>> tables = tables_of(model_table, "region", in_file);
  if (!tables) return tables.error();
  for (const toml::table* table : *tables) {
    Result<SceneRegion> region = read_region(*table, in_file);
    if (!region) return std::move(region).error();
    model.regions.push_back(*std::move(region));
  }
  return Done{};
}

Status read_motion(const toml::table& model_table, SceneModel& model, const InFile& in_file) {
  const toml::node* node = model_table.get("motion");
  if (node == nullptr) return Done{};
  const Result<const toml::table*> table = table_of(*node, "model.motion", in_file);
  if (!table) return table.error();
  if (const Status keys =
          check_keys(**table, {"velocity_mm_s", "turn_deg_s", "about_mm", "start_s", "stop_s"}, {},
                     "[model.motion]", in_file);
      !keys)
    return keys.error();
  SceneMotion motion;
  const auto vector = [&](const char* key) -> Result<std::optional<Vec3>> {
    const toml::node* entry = (*table)->get(key);
    if (entry == nullptr) return std::optional<Vec3>();
    const auto v = numbers<3>(*entry, key, in_file);
    if (!v) return v.error();
    return std::optional<Vec3>(Vec3((*v)[0], (*v)[1], (*v)[2]));
  };
  const auto velocity = vector("velocity_mm_s"), turn = vector("turn_deg_s"), about = vector("about_mm");
  for (const auto* read : {&velocity, &turn, &about})
    if (!*read) return read->error();
  motion.velocity_mm_s = velocity->value_or(Vec3::Zero());
  motion.turn_rad_s = turn->value_or(Vec3::Zero()) * (std::numbers::pi / 180.0);
  motion.about_mm = *about;
  if (const toml::node* start = (*table)->get("start_s")) {
    const Result<double> value = number(*start, "start_s", in_file);
    if (!value) return value.error();
    if (*value < 0.0) return in_file.at(*start, "'start_s' must not be below 0");
    motion.start_s = *value;
  }
  if (const toml::node* stop = (*table)->get("stop_s")) {
    const Result<double> value = number(*stop, "stop_s", in_file);
    if (!value) return value.error();
    if (!(*value > motion.start_s)) return in_file.at(*stop, "'stop_s' must be later than 'start_s'");
    motion.stop_s = *value;
  }
  if (motion.velocity_mm_s.isZero(0.0) && motion.turn_rad_s.isZero(0.0))
    return in_file.at(*node, "[model.motion] moves nothing",
                      "give it velocity_mm_s or turn_deg_s, or leave it out");
  if (motion.about_mm && motion.turn_rad_s.isZero(0.0))
    return in_file.at(*(*table)->get("about_mm"), "'about_mm' does nothing without a turn",
                      "give turn_deg_s too, or leave it out");
  model.motion = motion;
  return Done{};
}

}  // namespace palpate::scene
