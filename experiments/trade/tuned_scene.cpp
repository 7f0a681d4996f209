#include <toml++/toml.h>
#include <filesystem>
#include <sstream>

#include <palpate/result.h>
#include "experiments/trade/tune.h"
#include "toolkit/core/files.h"

namespace palpate::experiments {
namespace {

namespace fs = std::filesystem;

/// Writes numbers and flags bare, all else in quotes.
void set_option(toml::table& table, const std::string& key, const std::string& value) {
  if (const Result<long long> whole = parse_integer(value))
    table.insert_or_assign(key, std::int64_t{*whole});
  else if (const Result<double> number = parse_number(value))
    table.insert_or_assign(key, *number);
  else if (value == "true" || value == "false")
    table.insert_or_assign(key, value == "true");
  else
    table.insert_or_assign(key, value);
}

std::string absolute_path(const std::string& path, const fs::path& folder) {
  return fs::absolute(fs::path(path).is_absolute() ? fs::path(path) : folder / path)
      .lexically_normal()
      .string();
}

void make_absolute(toml::node* table, const char* key, const fs::path& folder) {
  if (table == nullptr || !table->is_table()) return;
  if (const auto path = (*table->as_table())[key].value<std::string>())
    table->as_table()->insert_or_assign(key, absolute_path(*path, folder));
}

void make_model_absolute(toml::table& model, const fs::path& folder) {
  make_absolute(&model, "cloud", folder);
  if (toml::array* views = model["view"].as_array())
    for (toml::node& view : *views) make_absolute(&view, "cloud", folder);
  make_absolute(model["surface"]["friction"].node(), "image", folder);
  make_absolute(model["surface"]["texture"].node(), "image", folder);
}

/// Writes the command line's load settings as load() reads them.
void add_load(toml::table& model, const ModelArguments& load) {
  const bool of_file = model.contains("cloud") || model.contains("scan");
  if (of_file && !load.unit.empty() && !model.contains("unit")) model.insert_or_assign("unit", load.unit);
  if (load.scale > 0.0) model.insert_or_assign("scale", load.scale);
  if (of_file && load.post_mm > 0.0) model.insert_or_assign("post_mm", load.post_mm);
  if (of_file && load.vertical_mm > 0.0) model.insert_or_assign("vertical_mm", load.vertical_mm);
  if (of_file && !load.no_data.empty())
    if (const Result<double> number = parse_number(load.no_data)) model.insert_or_assign("no_data", *number);
  if (!of_file || load.within.empty()) return;
  if (const Result<geometry::Aabb> box = parse_within(load.within)) {
    const Vec3 &low = box->low_mm, &high = box->high_mm;
    model.insert_or_assign("within_mm", toml::array{toml::array{low.x(), low.y(), low.z()},
                                                    toml::array{high.x(), high.y(), high.z()}});
  }
}

/// A scene of one model named on the command line.
toml::table of_model(const scene::SceneModel& model) {
  toml::table table;
  if (model.generate) {
    table.insert_or_assign("generate", model.generate->name);
    for (const auto& [key, value] : model.generate->options.all()) set_option(table, key, value);
  } else if (!model.scan.empty()) {
    table.insert_or_assign("scan", model.scan);
  } else {
    table.insert_or_assign("cloud", absolute_path(model.cloud, fs::current_path()));
  }
  toml::array models;
  models.push_back(std::move(table));
  toml::table scene;
  scene.insert_or_assign("model", std::move(models));
  return scene;
}

Result<toml::table> of_file(const std::string& path) {
  PALPATE_ASSIGN(const std::string text, read_file(path, scene::kMaxSceneBytes));
  try {
    toml::table scene = toml::parse(text);
    if (toml::array* models = scene["model"].as_array())
      for (toml::node& model : *models)
        if (model.is_table()) make_model_absolute(*model.as_table(), fs::absolute(path).parent_path());
    return scene;
  } catch (const toml::parse_error& error) {
    return Error{
        std::string(error.description()), {}, path, static_cast<std::int64_t>(error.source().begin.line)};
  }
}

}  // namespace

Result<std::string> tuned_scene(const CheckedRun& checked, const ModelArguments& load,
                                const NamedOptions& renderer) {
  const scene::SceneFile& scene = checked.stage.scene;
  toml::table whole;
  if (fs::path(scene.path).extension() == ".toml") {
    PALPATE_ASSIGN(whole, of_file(scene.path));
  } else {
    whole = of_model(scene.models.front());
  }
  if (toml::array* models = whole["model"].as_array())
    for (toml::node& model : *models)
      if (model.is_table()) add_load(*model.as_table(), load);
  toml::table own;
  own.insert_or_assign("name", renderer.name);
  for (const auto& [key, value] : renderer.options.all()) set_option(own, key, value);
  whole.insert_or_assign("renderer", std::move(own));
  std::ostringstream text;
  text << whole << "\n";
  return text.str();
}

}  // namespace palpate::experiments
