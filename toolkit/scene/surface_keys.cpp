// [model.surface], [[model.region]] and [model.motion].
#include <filesystem>
#include <limits>
#include <numbers>

#include "toolkit/scene/toml_reading.h"

namespace palpate::scene {
namespace {

/// { column = "name" }: the column's name; empty where the value is something else.
Result<std::string> column_of(const toml::node& node, const std::string& key, const Place& place) {
  const toml::table* table = node.as_table();
  if (table == nullptr || table->get("column") == nullptr) return std::string();
  if (const Status keys = check_keys(*table, {"column"}, {}, fmt::format("'{}'", key), place); !keys)
    return keys.error();
  return text(*table->get("column"), key + ".column", place);
}

/// A path in a scene is relative to the scene file.
Result<std::string> file_of(const toml::node& node, const std::string& key, const Place& place) {
  const Result<std::string> name = text(node, key, place);
  if (!name) return name;
  return (std::filesystem::path(place.file).parent_path() / *name).lexically_normal().string();
}

Result<double> positive(const toml::node& node, const std::string& key, const Place& place) {
  const Result<double> value = number(node, key, place);
  if (value && !(*value > 0.0)) return place.at(node, fmt::format("'{}' must be above 0", key));
  return value;
}

Result<double> share(const toml::node& node, const std::string& key, const Place& place) {
  const Result<double> value = number(node, key, place);
  if (value && !(*value >= 0.0 && *value < 1.0))
    return place.at(node, fmt::format("'{}' must be at least 0 and below 1", key));
  return value;
}

/// A number (both coefficients), or { static = .., dynamic = .. }.
Result<surface::Friction> friction(const toml::node& node, const Place& place) {
  surface::Friction both;
  if (const toml::table* table = node.as_table()) {
    if (const Status keys = check_keys(*table, {"static", "dynamic"}, {}, "'friction'", place); !keys)
      return keys.error();
    const toml::node *rest = table->get("static"), *slip = table->get("dynamic");
    if (rest == nullptr || slip == nullptr)
      return place.at(node, "'friction' needs 'static' and 'dynamic'", "or one number for both");
    const Result<double> static_value = number(*rest, "friction.static", place);
    if (!static_value) return static_value.error();
    const Result<double> dynamic_value = number(*slip, "friction.dynamic", place);
    if (!dynamic_value) return dynamic_value.error();
    both = {*static_value, *dynamic_value};
  } else {
    const Result<double> one = number(node, "friction", place);
    if (!one) return one.error();
    both = {*one, *one};
  }
  if (!(both.dynamic_coefficient >= 0.0) || both.dynamic_coefficient > both.static_coefficient)
    return place.at(node, "'friction' needs static >= dynamic >= 0");
  return both;
}

Result<FrictionMap> friction_map(const toml::table& table, const Place& place) {
  if (const Status keys = check_keys(table, {"image", "tile_mm", "low", "high"}, {}, "'friction'", place);
      !keys)
    return keys.error();
  for (const char* key : {"image", "tile_mm", "low", "high"})
    if (table.get(key) == nullptr)
      return place.at(table, fmt::format("a friction map needs '{}'", key),
                      "friction = { image = \"mu.pfm\", tile_mm = 20, low = 0.1, high = 0.8 }");
  FrictionMap map;
  const Result<std::string> image = file_of(*table.get("image"), "friction.image", place);
  if (!image) return image.error();
  const Result<double> tile = positive(*table.get("tile_mm"), "friction.tile_mm", place);
  if (!tile) return tile.error();
  const Result<double> low = number(*table.get("low"), "friction.low", place);
  if (!low) return low.error();
  const Result<double> high = number(*table.get("high"), "friction.high", place);
  if (!high) return high.error();
  if (!(*low >= 0.0 && *high >= *low)) return place.at(table, "a friction map needs 0 <= low <= high");
  return FrictionMap{*image, *tile, *low, *high};
}

Status read_friction(const toml::node& node, SceneModel& model, const Place& place) {
  if (const toml::table* table = node.as_table()) {
    if (table->get("image") != nullptr) {
      const Result<FrictionMap> map = friction_map(*table, place);
      if (!map) return map.error();
      model.sources.friction_map = *map;
      return Done{};
    }
    if (table->get("column") != nullptr) {
      if (const Status keys = check_keys(*table, {"column", "dynamic_column"}, {}, "'friction'", place);
          !keys)
        return keys.error();
      const Result<std::string> name = text(*table->get("column"), "friction.column", place);
      if (!name) return name.error();
      model.sources.static_friction_column = *name;
      if (const toml::node* dynamic = table->get("dynamic_column")) {
        const Result<std::string> second = text(*dynamic, "friction.dynamic_column", place);
        if (!second) return second.error();
        model.sources.dynamic_friction_column = *second;
      }
      return Done{};
    }
  }
  const Result<surface::Friction> value = friction(node, place);
  if (!value) return value.error();
  model.surface.friction = *value;
  return Done{};
}

/// The one of `choices` that the text names.
template <class T, std::size_t n>
Result<T> choice(const toml::node& node, const std::string& key,
                 const std::array<std::pair<const char*, T>, n>& choices, const Place& place) {
  const Result<std::string> name = text(node, key, place);
  if (!name) return name.error();
  std::string all;
  for (const auto& [known, value] : choices) {
    if (*name == known) return value;
    all += (all.empty() ? "" : ", ") + std::string(known);
  }
  return place.at(node, fmt::format("there is no {} '{}'", key, *name), "choose from " + all);
}

Status read_texture(const toml::node& node, SceneModel& model, const Place& place) {
  using enum surface::TextureKind;
  const Result<const toml::table*> table = table_of(node, "model.surface.texture", place);
  if (!table) return table.error();
  if (const Status keys =
          check_keys(**table, {"kind", "effect", "depth_mm", "wavelength_mm", "axis", "seed", "image"}, {},
                     "[model.surface.texture]", place);
      !keys)
    return keys.error();
  for (const char* key : {"kind", "depth_mm", "wavelength_mm"})
    if ((*table)->get(key) == nullptr)
      return place.at(node, fmt::format("[model.surface.texture] needs '{}'", key));
  surface::Texture& t = model.surface.texture;
  const auto kind = choice<surface::TextureKind, 3>(
      *(*table)->get("kind"), "kind", {{{"grating", kGrating}, {"noise", kNoise}, {"image", kImage}}}, place);
  if (!kind) return kind.error();
  t.kind = *kind;
  if (const toml::node* effect = (*table)->get("effect")) {
    const auto value = choice<surface::TextureEffect, 2>(
        *effect, "effect",
        {{{"god-object", surface::TextureEffect::kGodObject}, {"force", surface::TextureEffect::kForce}}},
        place);
    if (!value) return value.error();
    t.effect = *value;
  }
  const Result<double> depth = positive(*(*table)->get("depth_mm"), "depth_mm", place);
  if (!depth) return depth.error();
  const Result<double> wavelength = positive(*(*table)->get("wavelength_mm"), "wavelength_mm", place);
  if (!wavelength) return wavelength.error();
  t.depth_mm = *depth;
  t.wavelength_mm = *wavelength;
  if (const toml::node* axis = (*table)->get("axis")) {
    const auto v = numbers<3>(*axis, "axis", place);
    if (!v) return v.error();
    t.axis = Vec3((*v)[0], (*v)[1], (*v)[2]);
    if (!(t.axis.norm() > 0.0)) return place.at(*axis, "'axis' must not be 0");
    t.axis.normalize();
  }
  if (const toml::node* seed = (*table)->get("seed")) {
    const auto value = seed->value_exact<std::int64_t>();
    if (!value || *value < 0) return place.at(*seed, "'seed' must be a whole number, 0 or more");
    t.seed = static_cast<std::uint64_t>(*value);
  }
  const toml::node* image = (*table)->get("image");
  if ((t.kind == kImage) != (image != nullptr))
    return place.at(node, t.kind == kImage ? "a texture of kind \"image\" needs 'image'"
                                           : "only a texture of kind \"image\" has 'image'");
  if (image == nullptr) return Done{};
  const Result<std::string> file = file_of(*image, "image", place);
  if (!file) return file.error();
  model.sources.texture_image = *file;
  return Done{};
}

Status read_dent(const toml::node& node, SceneModel& model, const Place& place) {
  const Result<const toml::table*> table = table_of(node, "model.surface.dent", place);
  if (!table) return table.error();
  if (const Status keys =
          check_keys(**table, {"yield_mm", "radius_mm", "rate_mm_s"}, {}, "[model.surface.dent]", place);
      !keys)
    return keys.error();
  for (const auto& [key, value] : {std::pair{"yield_mm", &model.surface.dent.yield_mm},
                                   std::pair{"radius_mm", &model.surface.dent.radius_mm},
                                   std::pair{"rate_mm_s", &model.surface.dent.rate_mm_s}}) {
    const toml::node* entry = (*table)->get(key);
    if (entry == nullptr) return place.at(node, fmt::format("[model.surface.dent] needs '{}'", key));
    const Result<double> read = positive(*entry, key, place);
    if (!read) return read.error();
    *value = *read;
  }
  return Done{};
}

/// A range [low, high] of one axis of a region; without the key: everything.
Status read_range(const toml::table& table, const char* key, int axis, geometry::Aabb& box,
                  const Place& place) {
  box.low_mm[axis] = -std::numeric_limits<double>::infinity();
  box.high_mm[axis] = std::numeric_limits<double>::infinity();
  const toml::node* node = table.get(key);
  if (node == nullptr) return Done{};
  const auto range = numbers<2>(*node, key, place);
  if (!range) return range.error();
  if (!((*range)[0] <= (*range)[1])) return place.at(*node, fmt::format("'{}' must be [low, high]", key));
  box.low_mm[axis] = (*range)[0];
  box.high_mm[axis] = (*range)[1];
  return Done{};
}

Result<SceneRegion> read_region(const toml::table& table, const Place& place) {
  if (const Status keys =
          check_keys(table, {"x_mm", "y_mm", "z_mm", "stiffness_n_per_mm", "friction", "deformation"}, {},
                     "a [[model.region]]", place);
      !keys)
    return keys.error();
  SceneRegion region;
  region.line = static_cast<std::int64_t>(table.source().begin.line);
  int axis = 0;
  for (const char* key : {"x_mm", "y_mm", "z_mm"})
    if (const Status range = read_range(table, key, axis++, region.box_mm, place); !range)
      return range.error();
  if (const toml::node* node = table.get("stiffness_n_per_mm")) {
    const Result<double> value = positive(*node, "stiffness_n_per_mm", place);
    if (!value) return value.error();
    region.stiffness_n_per_mm = *value;
  }
  if (const toml::node* node = table.get("friction")) {
    const Result<surface::Friction> value = friction(*node, place);
    if (!value) return value.error();
    region.friction = *value;
  }
  if (const toml::node* node = table.get("deformation")) {
    const Result<double> value = share(*node, "deformation", place);
    if (!value) return value.error();
    region.deformation = *value;
  }
  if (!region.stiffness_n_per_mm && !region.friction && !region.deformation)
    return place.at(table, "a [[model.region]] changes nothing",
                    "give it stiffness_n_per_mm, friction or deformation");
  return region;
}

}  // namespace

Status read_surface(const toml::table& model_table, SceneModel& model, const Place& place) {
  const toml::node* node = model_table.get("surface");
  if (node == nullptr) return Done{};
  const Result<const toml::table*> table = table_of(*node, "model.surface", place);
  if (!table) return table.error();
  const toml::table& surface = **table;
  if (const Status keys =
          check_keys(surface, {"stiffness_n_per_mm", "friction", "deformation", "texture", "dent"},
                     {"damping", "damping_n_s_per_mm"}, "[model.surface]", place);
      !keys)
    return keys.error();
  model.sources.line = static_cast<std::int64_t>(node->source().begin.line);
  if (const toml::node* stiffness = surface.get("stiffness_n_per_mm")) {
    const Result<std::string> column = column_of(*stiffness, "stiffness_n_per_mm", place);
    if (!column) return column.error();
    model.sources.stiffness_column = *column;
    if (column->empty()) {
      const Result<double> value = positive(*stiffness, "stiffness_n_per_mm", place);
      if (!value) return value.error();
      model.surface.stiffness_n_per_mm = *value;
    }
  }
  if (const toml::node* rub = surface.get("friction"))
    if (const Status read = read_friction(*rub, model, place); !read) return read.error();
  if (const toml::node* deformation = surface.get("deformation")) {
    const Result<std::string> column = column_of(*deformation, "deformation", place);
    if (!column) return column.error();
    model.sources.deformation_column = *column;
    if (column->empty()) {
      const Result<double> value = share(*deformation, "deformation", place);
      if (!value) return value.error();
      model.surface.deformation = *value;
    }
  }
  if (const toml::node* texture = surface.get("texture"))
    if (const Status read = read_texture(*texture, model, place); !read) return read.error();
  if (const toml::node* dent = surface.get("dent"))
    if (const Status read = read_dent(*dent, model, place); !read) return read.error();
  return Done{};
}

Status read_regions(const toml::table& model_table, SceneModel& model, const Place& place) {
  const Result<std::vector<const toml::table*>> tables = tables_of(model_table, "region", place);
  if (!tables) return tables.error();
  for (const toml::table* table : *tables) {
    Result<SceneRegion> region = read_region(*table, place);
    if (!region) return std::move(region).error();
    model.regions.push_back(*std::move(region));
  }
  return Done{};
}

Status read_motion(const toml::table& model_table, SceneModel& model, const Place& place) {
  const toml::node* node = model_table.get("motion");
  if (node == nullptr) return Done{};
  const Result<const toml::table*> table = table_of(*node, "model.motion", place);
  if (!table) return table.error();
  if (const Status keys =
          check_keys(**table, {"velocity_mm_s", "turn_deg_s", "about_mm", "start_s", "stop_s"}, {},
                     "[model.motion]", place);
      !keys)
    return keys.error();
  SceneMotion motion;
  const auto vector = [&](const char* key) -> Result<std::optional<Vec3>> {
    const toml::node* entry = (*table)->get(key);
    if (entry == nullptr) return std::optional<Vec3>();
    const auto v = numbers<3>(*entry, key, place);
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
    const Result<double> value = number(*start, "start_s", place);
    if (!value) return value.error();
    if (*value < 0.0) return place.at(*start, "'start_s' must not be below 0");
    motion.start_s = *value;
  }
  if (const toml::node* stop = (*table)->get("stop_s")) {
    const Result<double> value = number(*stop, "stop_s", place);
    if (!value) return value.error();
    if (!(*value > motion.start_s)) return place.at(*stop, "'stop_s' must be later than 'start_s'");
    motion.stop_s = *value;
  }
  model.motion = motion;
  return Done{};
}

}  // namespace palpate::scene
