// The TOML side of a scene.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <optional>

#include <palpate/generate.h>
#include <palpate/result.h>
#include "toolkit/cloud/sampling.h"
#include "toolkit/control/coupling_and_passivity.h"
#include "toolkit/core/files.h"
#include "toolkit/scene/model_keys.h"

namespace palpate::scene {
namespace {

/// Where a model's points come from.
constexpr const char* kOfFile = "a [[model]] with a file";
constexpr const char* kOfScan = "a [[model]] with a scan";
constexpr const char* kOfGenerator = "a [[model]] with a generator";

Status read_unit(const toml::node& node, SceneModel& model, const TomlFile& in_file) {
  PALPATE_ASSIGN(const std::string name, text(node, "unit", in_file));
  const Result<io::Unit> unit = io::parse_unit(name);
  if (!unit) return in_file.at(node, unit.error().what, unit.error().remedy);
  model.unit = *unit;
  return Done{};
}

Status read_no_data(const toml::node& node, SceneModel& model, const TomlFile& in_file) {
  PALPATE_ASSIGN(model.no_data, number(node, "no_data", in_file, NumberRange{}));
  return Done{};
}

Status read_within(const toml::node& node, SceneModel& model, const TomlFile& in_file) {
  std::vector<Vec3> corners;
  PALPATE_TRY(read_value(node, "within_mm", corners, in_file));
  if (corners.size() != 2)
    return in_file.at(node, "'within_mm' must be two corners", "within_mm = [[0, 0, 0], [100, 100, 50]]");
  model.within_mm = geometry::Aabb{corners[0], corners[1]};
  if (const Status box = io::check_box(*model.within_mm); !box)
    return in_file.at(node, box.error().what, box.error().remedy);
  return Done{};
}

Status read_sample(const toml::node& node, SceneModel& model, const TomlFile& in_file) {
  PALPATE_ASSIGN(const std::string spelt, text(node, "sample", in_file));
  const Result<NamedOptions> named = parse_named_options(spelt);
  if (!named) return in_file.at(node, named.error().what, named.error().remedy);
  const Result<Options> complete = cloud::complete_sampling(*named);
  if (!complete) return in_file.at(node, complete.error().what, complete.error().remedy);
  model.sample = *named;
  return Done{};
}

/// The fields of a model of each kind of source; with the options of `generator` for the kind `generated`, or
/// of all generators if null.
Fields model_fields(SceneModel& model, const cloud::Generator* generator, const std::string& generated) {
  Fields fields = pose_fields(model.world_from_model);
  fields.push_back(field("scale", model.scale, kScales));
  fields.push_back(file("cloud", model.cloud).of({kOfFile}));
  fields.push_back(field("scan", model.scan).of({kOfScan}));
  fields.push_back(field("generate", model.name).of({generated}));
  const auto of_files = [&fields](Field one) { fields.push_back(std::move(one).of({kOfFile, kOfScan})); };
  of_files(whole_field("unit", model, &read_unit));
  fields.push_back(whole_field("sample", model, &read_sample));
  of_files(field("post_mm", model.post_mm, kLengthsMm));
  of_files(field("vertical_mm", model.vertical_mm, kLengthsMm));
  of_files(whole_field("no_data", model, &read_no_data));
  of_files(whole_field("within_mm", model, &read_within));
  of_files(list(
      "view", model.views, [](SceneView& view, const std::string&) { return view_fields(view); }, {},
      "model.view"));
  const Field::Read option = [&model](const toml::node& node, const std::string& key,
                                      const TomlFile& in_file) -> Status {
    PALPATE_ASSIGN(std::string value, option_text(node, key, in_file));
    model.generate->options.set(key, std::move(value));
    return Done{};
  };
  for (const cloud::Generator& g : cloud::generators())
    if (generator == nullptr || &g == generator)
      for (const OptionSpec& spec : g.options)
        if (spec.key != "scale") fields.push_back(Field{spec.key, option}.of({generated}));
  fields.push_back(clean_field(model));
  fields.push_back(surface_field(model));
  fields.push_back(regions_field(model));
  fields.push_back(motion_field(model));
  return fields;
}

std::string nearest_generator(std::string_view wrong, const std::string& otherwise) {
  const std::vector<std::string> known = names_of(cloud::generators());
  return did_you_mean(wrong, known, otherwise + joined(known));
}

Result<const cloud::Generator*> generator_of(const toml::node& node, const TomlFile& in_file) {
  PALPATE_ASSIGN(const std::string name, text(node, "generate", in_file));
  const cloud::Generator* generator = cloud::find_generator(name);
  if (generator != nullptr) return generator;
  return in_file.at(node, fmt::format("there is no generator {}", shown(name)),
                    nearest_generator(name, "choose from "));
}

std::string base_name(const std::string& path) {
  const std::string name = std::filesystem::path(path).filename().string();
  return name.substr(0, name.find('.', 1));
}

Status read_model(const toml::table& table, SceneModel& model, const TomlFile& in_file) {
  model.line = static_cast<std::int64_t>(table.source().begin.line);
  const toml::node *file = table.get("cloud"), *scan = table.get("scan"), *generate = table.get("generate");
  if ((file != nullptr) + (generate != nullptr) + (scan != nullptr) != 1)
    return in_file.at(table, "a [[model]] needs either 'cloud' or 'generate' or 'scan'",
                      "cloud = \"file.ply\", generate = \"sinusoid\", or scan = \"stanford-dragon\"");
  const cloud::Generator* generator = nullptr;
  if (generate != nullptr) {
    PALPATE_ASSIGN(generator, generator_of(*generate, in_file));
    model.generate = NamedOptions{generator->name, {}};
  }
  const std::string generated = generator == nullptr
                                    ? kOfGenerator
                                    : fmt::format("a [[model]] with generate = \"{}\"", generator->name);
  const std::string kind = file != nullptr ? kOfFile : scan != nullptr ? kOfScan : generated;
  PALPATE_TRY(read_fields(table, model_fields(model, generator, generated), kind, kind, in_file));
  if (file != nullptr) model.name = base_name(model.cloud);
  if (scan != nullptr) model.name = model.scan;
  if (generator == nullptr) return Done{};
  // Checks values here, where the line is known.
  const Result<Options> checked = cloud::complete_options(*generator, model.generate->options);
  if (!checked) return in_file.at(table, checked.error().what, checked.error().remedy);
  return Done{};
}

Status read_models(const toml::node& node, SceneFile& scene, const TomlFile& in_file) {
  PALPATE_ASSIGN(const auto tables, tables_of(node, "model", in_file));
  for (const toml::table* table : tables)
    PALPATE_TRY(read_model(*table, scene.models.emplace_back(), in_file));
  return Done{};
}

Status read_renderer(const toml::node& node, SceneFile& scene, const TomlFile& in_file) {
  PALPATE_ASSIGN(const toml::table* table, table_of(node, "renderer", in_file));
  NamedOptions renderer;
  for (const auto& [key, value] : *table) {
    const std::string name(key.str());
    PALPATE_ASSIGN(std::string option, option_text(value, name, in_file));
    if (name == "name")
      renderer.name = std::move(option);
    else
      renderer.options.set(name, std::move(option));
  }
  if (renderer.name.empty())
    return in_file.at(node, "[renderer] needs 'name'", "`palpate list renderers` lists them");
  scene.renderer = std::move(renderer);
  scene.renderer_line = static_cast<std::int64_t>(node.source().begin.line);
  return Done{};
}

Fields coupling_fields(control::Coupling& coupling) {
  return {field("stiffness_n_per_mm", coupling.stiffness_n_per_mm, kStiffnessesNPerMm,
                "leave out 'coupling' for none"),
          field("damping_n_s_per_mm", coupling.damping_n_s_per_mm)};
}

Status read_coupling(const toml::node& node, SceneFile& scene, const TomlFile& in_file) {
  const toml::table* table = node.as_table();
  if (table == nullptr)
    return in_file.at(node, "'coupling' must be a table",
                      "write coupling = { stiffness_n_per_mm = 0.5, damping_n_s_per_mm = 0 }");
  control::Coupling coupling;
  PALPATE_TRY(read_fields(*table, coupling_fields(coupling), "coupling", {}, in_file));
  if (const Status right = control::check(coupling); !right)
    return in_file.at(node, right.error().what, right.error().remedy);
  scene.control.coupling = coupling;
  return Done{};
}

Fields passivity_fields(control::PassivityOptions& passivity) {
  return {field("damping_limit_n_s_per_mm", passivity.damping_limit_n_s_per_mm, kDampingsNSPerMm,
                "leave it out for the default")};
}

/// true, false, or a table with the damping limit.
Status read_passivity(const toml::node& node, SceneFile& scene, const TomlFile& in_file) {
  control::PassivityOptions passivity;
  const std::optional<bool> on = node.value_exact<bool>();
  if (const toml::table* table = node.as_table())
    PALPATE_TRY(read_fields(*table, passivity_fields(passivity), "passivity", {}, in_file));
  else if (!on)
    return in_file.at(node, "'passivity' must be true or false",
                      "or write passivity = { damping_limit_n_s_per_mm = 0.005 }");
  if (on.value_or(true)) scene.control.passivity = passivity;
  return Done{};
}

Fields control_fields(SceneFile& scene) {
  constexpr const char* kNoLimit = "leave it out for no limit";
  control::ForceFilterOptions& filter = scene.control.filter;
  return {field("force_limit_n", scene.force_limit_n, kForcesN, kNoLimit),
          whole_field("coupling", scene, &read_coupling),
          field("rate_limit_n_per_s", filter.rate_limit_n_per_s, kForceRatesNPerS, kNoLimit),
          field("turn_limit_deg_per_s", filter.turn_limit_deg_per_s, kAngularSpeedsDegPerS, kNoLimit),
          choice("filter", filter.form,
                 {{"per-time", control::FilterForm::kPerTime}, {"literal", control::FilterForm::kLiteral}}),
          whole_field("passivity", scene, &read_passivity)};
}

Status read_control(const toml::node& node, SceneFile& scene, const TomlFile& in_file) {
  PALPATE_ASSIGN(const toml::table* table, table_of(node, "control", in_file));
  PALPATE_TRY(read_fields(*table, control_fields(scene), "[control]", {}, in_file));
  if (const toml::node* filter = table->get("filter"); filter != nullptr && !scene.control.filter.any())
    return in_file.at(*filter, "'filter' limits nothing", "add rate_limit_n_per_s or turn_limit_deg_per_s");
  return Done{};
}

Fields simulation_fields(SceneFile& scene) {
  return {field("rate_hz", scene.simulation_hz, kRatesHz)};
}

Status read_simulation(const toml::node& node, SceneFile& scene, const TomlFile& in_file) {
  PALPATE_ASSIGN(const toml::table* table, table_of(node, "simulation", in_file));
  PALPATE_TRY(read_fields(*table, simulation_fields(scene), "[simulation]", {}, in_file));
  const bool moves = std::any_of(scene.models.begin(), scene.models.end(),
                                 [](const SceneModel& model) { return model.motion.has_value(); });
  if (const toml::node* rate = table->get("rate_hz"); rate != nullptr && !moves)
    return in_file.at(*rate, "'rate_hz' does nothing: no model moves",
                      "give one a [model.motion], or leave it out");
  return Done{};
}

Fields view_fields(SceneFile& scene) {
  return {choice("up", scene.view_up,
                 {{"z", "z"}, {"y", "y"}, {"x", "x"}, {"-z", "-z"}, {"-y", "-y"}, {"-x", "-x"}})};
}

Status read_view(const toml::node& node, SceneFile& scene, const TomlFile& in_file) {
  PALPATE_ASSIGN(const toml::table* table, table_of(node, "view", in_file));
  return read_fields(*table, view_fields(scene), "[view]", {}, in_file);
}

/// In reading order: the simulation depends on moving models.
Fields scene_fields(SceneFile& scene) {
  return {whole_field("model", scene, &read_models),
          whole_field("renderer", scene, &read_renderer),
          whole_field("control", scene, &read_control),
          whole_field("simulation", scene, &read_simulation),
          whole_field("view", scene, &read_view),
          {"plan", nullptr},
          {"device", nullptr},
          {"light", nullptr}};
}

Result<SceneFile> from_table(const toml::table& root, const std::string& path) {
  SceneFile scene;
  scene.path = path;
  PALPATE_TRY(read_fields(root, scene_fields(scene), "the scene", {}, TomlFile{path}));
  if (scene.models.empty())
    return Error{"the scene has no model",
                 "add [[model]] with cloud = \"file.ply\" or generate = \"sinusoid\"", path, 1};
  return scene;
}

}  // namespace

Result<SceneFile> parse_scene(std::string_view contents, const std::string& path) {
  if (contents.size() > kMaxSceneBytes)
    return Error{fmt::format("the scene file is larger than {} bytes", kMaxSceneBytes), "is it a scene?",
                 path};
  try {
    return from_table(toml::parse(contents, path), path);
  } catch (const toml::parse_error& error) {
    return Error{fmt::format("{} (column {})", error.description(), error.source().begin.column),
                 "the file must be TOML; docs/reference/scene-keys.md has an example", path,
                 static_cast<std::int64_t>(error.source().begin.line)};
  }
}

std::vector<TableKeys> scene_keys() {
  std::vector<TableKeys> all;
  const auto add = [&all](std::string table, const Fields& fields) {
    TableKeys keys{std::move(table), {}};
    for (const Field& one : fields)
      if (one.read) keys.keys.push_back(one.key);
    all.push_back(std::move(keys));
  };
  // Nothing is read: the fields are bound to a temporary.
  SceneFile scene;
  SceneModel model;
  SceneView view;
  SceneRegion region;
  SceneMotion motion;
  control::Coupling coupling;
  control::PassivityOptions passivity;
  add("", scene_fields(scene));
  Fields of_models = model_fields(model, nullptr, kOfGenerator);
  // Generators' options are listed elsewhere.
  std::erase_if(of_models, [](const Field& one) {
    return one.key != "generate" && one.kinds == std::vector<std::string>{kOfGenerator};
  });
  add("model", of_models);
  add("model.view", view_fields(view));
  add("model.surface", surface_fields(model));
  add("model.surface.texture", texture_fields(model));
  add("model.surface.dent", dent_fields(model.surface.dent));
  add("model.region", region_fields(region));
  add("model.motion", motion_fields(motion));
  add("control", control_fields(scene));
  add("control", coupling_fields(coupling));
  add("control", passivity_fields(passivity));
  add("simulation", simulation_fields(scene));
  add("view", view_fields(scene));
  return all;
}

Result<SceneFile> read_scene(const std::string& path) {
  PALPATE_ASSIGN(const std::string contents, read_file(path, kMaxSceneBytes));
  if (const Result<std::size_t> mark = byte_order_mark(contents); !mark)
    return Error(mark.error()).in_file(path);
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
    if (generator == nullptr)
      return Error{"there is no such file, and no generator of this name",
                   nearest_generator(argument.substr(0, argument.find(':')),
                                     "give a scene (.toml), a model file, or one of the generators "),
                   argument};
    PALPATE_TRY(cloud::complete_options(*generator, named->options));
    model.name = named->name;
    model.generate = *std::move(named);
  }
  scene.models.push_back(std::move(model));
  return scene;
}

}  // namespace palpate::scene
