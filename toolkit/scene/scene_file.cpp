// The TOML side of a scene.
#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "toolkit/cloud/generate.h"
#include "toolkit/scene/toml_reading.h"

namespace palpate::scene {
namespace {

/// The file or the generator of a model, with the generator's own keys.
Status read_source(const toml::table& table, SceneModel& model, const Place& place) {
  std::vector<std::string> known = {"cloud",       "scan",        "unit",     "scale",   "post_mm",
                                    "vertical_mm", "position_mm", "rotation", "surface", "region",
                                    "motion",      "view",        "clean"};
  const toml::node* cloud_node = table.get("cloud");
  const toml::node* generate_node = table.get("generate");
  const toml::node* scan_node = table.get("scan");
  if ((cloud_node != nullptr) + (generate_node != nullptr) + (scan_node != nullptr) != 1)
    return place.at(table, "a [[model]] needs either 'cloud' or 'generate' or 'scan'",
                    "cloud = \"file.ply\", generate = \"sinusoid\", or scan = \"stanford-dragon\"");
  if (scan_node != nullptr) {
    const Result<std::string> scan = text(*scan_node, "scan", place);
    if (!scan) return scan.error();
    model.scan = *scan;
    known.push_back("generate");
    return check_keys(table, known, {}, "a [[model]] with a scan", place);
  }
  if (cloud_node != nullptr) {
    const Result<std::string> file = text(*cloud_node, "cloud", place);
    if (!file) return file.error();
    const std::filesystem::path folder = std::filesystem::path(place.file).parent_path();
    model.cloud = (folder / *file).lexically_normal().string();
    known.push_back("generate");
    return check_keys(table, known, {}, "a [[model]] with a file", place);
  }
  const Result<std::string> name = text(*generate_node, "generate", place);
  if (!name) return name.error();
  const cloud::Generator* generator = cloud::find_generator(*name);
  if (generator == nullptr) {
    std::string all;
    for (const cloud::Generator& g : cloud::generators()) all += (all.empty() ? "" : ", ") + g.name;
    return place.at(*generate_node, fmt::format("there is no generator '{}'", *name), "choose from " + all);
  }
  known = {"generate", "scale", "position_mm", "rotation", "surface", "region", "motion", "clean"};
  for (const OptionSpec& spec : generator->options) known.push_back(spec.key);
  if (const Status keys =
          check_keys(table, known, {}, fmt::format("a [[model]] with generate = \"{}\"", *name), place);
      !keys)
    return keys.error();
  model.generate = NamedOptions{*name, {}};
  for (const OptionSpec& spec : generator->options) {
    const toml::node* node = table.get(spec.key);
    if (node == nullptr || spec.key == "scale") continue;
    const Result<std::string> value = option_text(*node, spec.key, place);
    if (!value) return value.error();
    model.generate->options.set(spec.key, *value);
  }
  // A wrong value is found here, where the line is known.
  if (const Result<Options> checked = validate(model.generate->options, generator->options, *name); !checked)
    return place.at(table, checked.error().what, checked.error().remedy);
  return Done{};
}

std::string base_name(const std::string& path) {
  const std::string name = std::filesystem::path(path).filename().string();
  return name.substr(0, name.find('.', 1));
}

Result<SceneModel> read_model_table(const toml::table& table, const Place& place) {
  SceneModel model;
  model.line = static_cast<std::int64_t>(table.source().begin.line);
  if (const Status source = read_source(table, model, place); !source) return source.error();
  model.name = model.generate        ? model.generate->name
               : !model.scan.empty() ? model.scan
                                     : base_name(model.cloud);
  if (const toml::node* node = table.get("unit")) {
    const Result<std::string> name = text(*node, "unit", place);
    if (!name) return name.error();
    const Result<io::Unit> unit = io::parse_unit(*name);
    if (!unit) return place.at(*node, unit.error().what, unit.error().remedy);
    model.unit = *unit;
  }
  if (const toml::node* node = table.get("scale")) {
    const Result<double> scale = number(*node, "scale", place);
    if (!scale) return scale.error();
    if (!(*scale > 0.0)) return place.at(*node, "'scale' must be above 0");
    model.scale = *scale;
  }
  for (const auto& [key, value] :
       {std::pair{"post_mm", &model.post_mm}, {"vertical_mm", &model.vertical_mm}}) {
    const toml::node* node = table.get(key);
    if (node == nullptr || model.generate) continue;
    const Result<double> read = number(*node, key, place);
    if (!read) return read.error();
    if (!(*read > 0.0)) return place.at(*node, fmt::format("'{}' must be above 0", key));
    *value = *read;
  }
  if (const Status pose = read_pose(table, model.world_from_model, place); !pose) return pose.error();
  if (const Status views = read_views(table, model, place); !views) return views.error();
  if (const Status clean = read_clean(table, model, place); !clean) return clean.error();
  if (const Status surface = read_surface(table, model, place); !surface) return surface.error();
  if (const Status regions = read_regions(table, model, place); !regions) return regions.error();
  if (const Status motion = read_motion(table, model, place); !motion) return motion.error();
  return model;
}

Status read_models(const toml::table& root, SceneFile& scene, const Place& place) {
  const toml::node* node = root.get("model");
  if (node == nullptr)
    return Error{"the scene has no model",
                 "add [[model]] with cloud = \"file.ply\" or generate = \"sinusoid\"", place.file, 1};
  const toml::array* models = node->as_array();
  if (models == nullptr || models->empty() || !models->is_homogeneous(toml::node_type::table))
    return place.at(*node, "'model' must be a list of tables", "write [[model]] with two brackets");
  for (const toml::node& entry : *models) {
    Result<SceneModel> model = read_model_table(*entry.as_table(), place);
    if (!model) return std::move(model).error();
    scene.models.push_back(*std::move(model));
  }
  return Done{};
}

Status read_renderer(const toml::table& root, SceneFile& scene, const Place& place) {
  const toml::node* node = root.get("renderer");
  if (node == nullptr) return Done{};
  const Result<const toml::table*> table = table_of(*node, "renderer", place);
  if (!table) return table.error();
  NamedOptions renderer;
  for (const auto& [key, value] : **table) {
    const std::string name(key.str());
    Result<std::string> option = option_text(value, name, place);
    if (!option) return std::move(option).error();
    if (name == "name")
      renderer.name = *option;
    else
      renderer.options.set(name, *option);
  }
  if (renderer.name.empty())
    return place.at(*node, "[renderer] needs 'name'", "`palpate renderers` lists them");
  scene.renderer = std::move(renderer);
  return Done{};
}

/// A number of `table` that must be above 0, or the value it has without the key.
Status read_positive(const toml::table& table, const char* key, const char* without, double& value,
                     const Place& place) {
  const toml::node* node = table.get(key);
  if (node == nullptr) return Done{};
  const Result<double> given = number(*node, key, place);
  if (!given) return given.error();
  if (!(*given > 0.0)) return place.at(*node, fmt::format("'{}' must be above 0", key), without);
  value = *given;
  return Done{};
}

Status read_coupling(const toml::table& control, SceneFile& scene, const Place& place) {
  const toml::node* node = control.get("coupling");
  if (node == nullptr) return Done{};
  const toml::table* table = node->as_table();
  if (table == nullptr)
    return place.at(*node, "'coupling' must be a table",
                    "write coupling = { stiffness_n_per_mm = 0.5, damping_n_s_per_mm = 0 }");
  if (const Status keys =
          check_keys(*table, {"stiffness_n_per_mm", "damping_n_s_per_mm"}, {}, "coupling", place);
      !keys)
    return keys.error();
  control::Coupling coupling;
  if (const Status read = read_positive(*table, "stiffness_n_per_mm", "leave out 'coupling' for none",
                                        coupling.stiffness_n_per_mm, place);
      !read)
    return read.error();
  if (const toml::node* damping = table->get("damping_n_s_per_mm")) {
    const Result<double> value = number(*damping, "damping_n_s_per_mm", place);
    if (!value) return value.error();
    coupling.damping_n_s_per_mm = *value;
  }
  if (const Status right = control::check(coupling); !right)
    return place.at(*node, right.error().what, right.error().remedy);
  scene.control.coupling = coupling;
  return Done{};
}

/// true, false, or a table with the limit of its damping.
Status read_passivity(const toml::table& control, SceneFile& scene, const Place& place) {
  const toml::node* node = control.get("passivity");
  if (node == nullptr) return Done{};
  control::PassivityOptions passivity;
  if (const std::optional<bool> on = node->value_exact<bool>()) {
    if (*on) scene.control.passivity = passivity;
    return Done{};
  }
  const toml::table* table = node->as_table();
  if (table == nullptr)
    return place.at(*node, "'passivity' must be true or false",
                    "or write passivity = { damping_limit_n_s_per_mm = 0.005 }");
  if (const Status keys = check_keys(*table, {"damping_limit_n_s_per_mm"}, {}, "passivity", place); !keys)
    return keys.error();
  if (const Status read = read_positive(*table, "damping_limit_n_s_per_mm", "leave it out for the default",
                                        passivity.damping_limit_n_s_per_mm, place);
      !read)
    return read.error();
  scene.control.passivity = passivity;
  return Done{};
}

Status read_filter(const toml::table& control, SceneFile& scene, const Place& place) {
  constexpr const char* kNoLimit = "leave it out for no limit";
  control::ForceFilterOptions& filter = scene.control.filter;
  if (const Status read =
          read_positive(control, "rate_limit_n_per_s", kNoLimit, filter.rate_limit_n_per_s, place);
      !read)
    return read.error();
  if (const Status read =
          read_positive(control, "turn_limit_deg_per_s", kNoLimit, filter.turn_limit_deg_per_s, place);
      !read)
    return read.error();
  const toml::node* node = control.get("filter");
  if (node == nullptr) return Done{};
  const Result<std::string> form = text(*node, "filter", place);
  if (!form) return form.error();
  if (*form != "per-time" && *form != "literal")
    return place.at(*node, fmt::format("there is no filter '{}'", *form), "choose from per-time, literal");
  if (!filter.any())
    return place.at(*node, "'filter' limits nothing", "add rate_limit_n_per_s or turn_limit_deg_per_s");
  if (*form == "literal") filter.form = control::FilterForm::kLiteral;
  return Done{};
}

Status read_control(const toml::table& root, SceneFile& scene, const Place& place) {
  const toml::node* node = root.get("control");
  if (node == nullptr) return Done{};
  const Result<const toml::table*> table = table_of(*node, "control", place);
  if (!table) return table.error();
  if (const Status keys = check_keys(
          **table,
          {"force_limit_n", "coupling", "passivity", "rate_limit_n_per_s", "turn_limit_deg_per_s", "filter"},
          {}, "[control]", place);
      !keys)
    return keys.error();
  if (const Status read =
          read_positive(**table, "force_limit_n", "leave it out for no limit", scene.force_limit_n, place);
      !read)
    return read.error();
  if (const Status coupling = read_coupling(**table, scene, place); !coupling) return coupling.error();
  if (const Status filter = read_filter(**table, scene, place); !filter) return filter.error();
  return read_passivity(**table, scene, place);
}

Status read_simulation(const toml::table& root, SceneFile& scene, const Place& place) {
  const toml::node* node = root.get("simulation");
  if (node == nullptr) return Done{};
  const Result<const toml::table*> table = table_of(*node, "simulation", place);
  if (!table) return table.error();
  if (const Status keys = check_keys(**table, {"rate_hz"}, {}, "[simulation]", place); !keys)
    return keys.error();
  if (const toml::node* rate = (*table)->get("rate_hz")) {
    const Result<double> value = number(*rate, "rate_hz", place);
    if (!value) return value.error();
    if (!(*value > 0.0)) return place.at(*rate, "'rate_hz' must be above 0");
    scene.simulation_hz = *value;
  }
  return Done{};
}

Result<SceneFile> from_table(const toml::table& root, const std::string& path) {
  const Place place{path};
  SceneFile scene;
  scene.path = path;
  if (const Status keys = check_keys(root, {"model", "renderer", "simulation", "control"},
                                     {"plan", "device", "light"}, "the scene", place);
      !keys)
    return keys.error();
  if (const Status models = read_models(root, scene, place); !models) return models.error();
  if (const Status renderer = read_renderer(root, scene, place); !renderer) return renderer.error();
  if (const Status control = read_control(root, scene, place); !control) return control.error();
  if (const Status simulation = read_simulation(root, scene, place); !simulation) return simulation.error();
  return scene;
}

}  // namespace

Result<SceneFile> parse_scene(std::string_view contents, const std::string& path) {
  if (contents.size() > kMaxSceneBytes)
    return Error{fmt::format("the scene file is larger than {} bytes", kMaxSceneBytes), "is it a scene?",
                 path, 0};
  try {
    return from_table(toml::parse(contents, path), path);
  } catch (const toml::parse_error& error) {
    return Error{fmt::format("{} (column {})", error.description(), error.source().begin.column),
                 "the file must be TOML; docs/scene.md has an example", path,
                 static_cast<std::int64_t>(error.source().begin.line)};
  }
}

Result<SceneFile> read_scene(const std::string& path) {
  std::error_code code;
  if (!std::filesystem::exists(path, code)) return Error{"there is no such file", "check the name", path, 0};
  if (!std::filesystem::is_regular_file(path, code))
    return Error{"is not a file", "give a scene file", path, 0};
  std::ifstream file(path, std::ios::binary);
  if (!file) return Error{"cannot be opened", "check its permissions", path, 0};
  std::string contents(kMaxSceneBytes + 1, '\0');
  file.read(contents.data(), static_cast<std::streamsize>(contents.size()));
  contents.resize(static_cast<std::size_t>(file.gcount()));
  return parse_scene(contents, path);
}

Result<SceneFile> open_scene(const std::string& argument) {
  std::error_code code;
  const bool exists = std::filesystem::exists(argument, code);
  if (std::filesystem::path(argument).extension() == ".toml") return read_scene(argument);
  SceneFile scene;
  scene.path = argument;
  SceneModel model;
  if (exists) {
    model.cloud = argument;
    model.name = base_name(argument);
  } else {
    Result<NamedOptions> named = parse_named_options(argument);
    const cloud::Generator* generator = named ? cloud::find_generator(named->name) : nullptr;
    if (generator == nullptr) {
      std::string all;
      for (const cloud::Generator& g : cloud::generators()) all += (all.empty() ? "" : ", ") + g.name;
      return Error{"there is no such file, and no generator of this name",
                   "give a scene (.toml), a model file, or one of the generators " + all, argument, 0};
    }
    if (Result<Options> checked = validate(named->options, generator->options, named->name); !checked)
      return std::move(checked).error();
    model.name = named->name;
    model.generate = *std::move(named);
  }
  scene.models.push_back(std::move(model));
  return scene;
}

}  // namespace palpate::scene
