#include "experiments/tables/manifest.h"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>

#include "toolkit/core/options.h"

namespace palpate::experiments {
namespace {

std::string text_of(const toml::table& table, const char* key) {
  const toml::node* node = table.get(key);
  return node == nullptr ? std::string() : node->value_or(std::string());
}

double number_of(const toml::table& table, const char* key, double otherwise) {
  const toml::node* node = table.get(key);
  return node == nullptr ? otherwise : node->value_or(otherwise);
}

/// The tables of an array of tables; none where the key is missing.
std::vector<const toml::table*> tables_of(const toml::table& root, const char* key) {
  std::vector<const toml::table*> found;
  const toml::array* array = root.get(key) == nullptr ? nullptr : root.get(key)->as_array();
  if (array == nullptr) return found;
  for (const toml::node& node : *array)
    if (node.is_table()) found.push_back(node.as_table());
  return found;
}

void read_printed(const toml::table& root, Manifest& manifest) {
  const toml::node* node = root.get("printed");
  if (node == nullptr || !node->is_table()) return;
  const toml::table& printed = *node->as_table();
  manifest.hardware = text_of(printed, "hardware");
  manifest.printed_points = static_cast<std::uint64_t>(number_of(printed, "points", 0.0));
  manifest.printed_frames = static_cast<std::uint64_t>(number_of(printed, "frames", 0.0));
  manifest.printed_min_ms = number_of(printed, "min_ms", 0.0);
  manifest.printed_max_ms = number_of(printed, "max_ms", 0.0);
  manifest.printed_mean_ms = number_of(printed, "mean_ms", 0.0);
}

Manifest from_table(const toml::table& root) {
  Manifest manifest;
  manifest.table = static_cast<int>(number_of(root, "table", 0.0));
  const std::string kind = text_of(root, "kind");
  manifest.kind = kind == "neighbours" ? Manifest::Kind::kNeighbours
                  : kind == "methods"  ? Manifest::Kind::kMethods
                  : kind == "meshes"   ? Manifest::Kind::kMeshes
                                       : Manifest::Kind::kFrames;
  manifest.title = text_of(root, "title");
  manifest.text = text_of(root, "text");
  if (const toml::array* notes = root.get("notes") == nullptr ? nullptr : root.get("notes")->as_array())
    for (const toml::node& note : *notes) manifest.notes.push_back(note.value_or(std::string()));
  if (const toml::array* walls = root.get("walls") == nullptr ? nullptr : root.get("walls")->as_array())
    for (const toml::node& wall : *walls)
      if (const double spacings = wall.value_or(0.0); spacings > 0.0)
        manifest.wall_spacings.push_back(spacings);
  if (const toml::node* paced = root.get("paced")) manifest.paced = paced->value_or(true);
  read_printed(root, manifest);
  for (const toml::table* t : tables_of(root, "model")) {
    ManifestModel model;
    model.name = text_of(*t, "name");
    model.scene = text_of(*t, "scene");
    model.generate = text_of(*t, "generate");
    model.scan = text_of(*t, "scan");
    model.stand_in = text_of(*t, "stand_in");
    model.quick = text_of(*t, "quick");
    model.unit = text_of(*t, "unit");
    model.scale = number_of(*t, "scale", 1.0);
    model.path = text_of(*t, "path");
    if (const toml::node* full = t->get("full")) model.full = full->value_or(false);
    if (const toml::array* slow = t->get("slow") == nullptr ? nullptr : t->get("slow")->as_array())
      for (const toml::node& builder : *slow) model.slow.push_back(builder.value_or(std::string()));
    model.in_time = text_of(*t, "in_time");
    model.points_in_time = static_cast<std::uint64_t>(number_of(*t, "points_in_time", 0.0));
    if (t->get("printed_min") != nullptr) model.printed_min = number_of(*t, "printed_min", 0.0);
    manifest.models.push_back(std::move(model));
  }
  if (const toml::node* node = root.get("path"); node != nullptr && node->is_table()) {
    manifest.path = text_of(*node->as_table(), "spec");
    manifest.quick_path = text_of(*node->as_table(), "quick");
    manifest.scan_path = text_of(*node->as_table(), "scan");
    manifest.contact_frames = static_cast<std::uint64_t>(number_of(*node->as_table(), "contact_frames", 0.0));
  }
  for (const toml::table* t : tables_of(root, "method")) {
    ManifestMethod method;
    method.renderer = text_of(*t, "renderer");
    method.label = text_of(*t, "label");
    method.kin = text_of(*t, "kin");
    method.preparation = text_of(*t, "preparation");
    method.broad = text_of(*t, "broad");
    method.narrow = text_of(*t, "narrow");
    method.response = text_of(*t, "response");
    for (const toml::table* p : tables_of(*t, "published"))
      method.published.push_back({number_of(*p, "points", 0.0), number_of(*p, "us", 0.0)});
    manifest.methods.push_back(std::move(method));
  }
  for (const toml::table* t : tables_of(root, "printed_mesh")) {
    PrintedMesh row{
        text_of(*t, "method"), text_of(*t, "model"), text_of(*t, "time"), text_of(*t, "machine"), {},
        text_of(*t, "kin"),    text_of(*t, "ours")};
    if (const toml::array* minutes = t->get("minutes") == nullptr ? nullptr : t->get("minutes")->as_array())
      for (const toml::node& m : *minutes) row.minutes.push_back(m.value_or(0.0));
    manifest.printed_meshes.push_back(std::move(row));
  }
  for (const toml::table* t : tables_of(root, "run"))
    manifest.runs.push_back({text_of(*t, "renderer"), text_of(*t, "quick")});
  return manifest;
}

}  // namespace

Result<Manifest> parse_manifest(std::string_view text, const std::string& name) {
  try {
    Manifest manifest = from_table(toml::parse(text, name));
    if (manifest.table <= 0 || manifest.models.empty())
      return Error{"a manifest needs 'table' and at least one [[model]]", {}, name, 1};
    return manifest;
  } catch (const toml::parse_error& error) {
    return Error{std::string(error.description()), "a manifest is TOML", name,
                 static_cast<std::int64_t>(error.source().begin.line)};
  }
}

Result<std::vector<Manifest>> manifests_for(const std::string& tables) {
  std::vector<Manifest> all;
  std::string known;
  for (const EmbeddedManifest& embedded : embedded_manifests()) {
    Result<Manifest> manifest = parse_manifest(embedded.text, embedded.name);
    if (!manifest) return std::move(manifest).error();
    all.push_back(*std::move(manifest));
  }
  std::sort(all.begin(), all.end(), [](const Manifest& a, const Manifest& b) { return a.table < b.table; });
  if (tables.empty()) return all;
  for (const Manifest& m : all) known += (known.empty() ? "" : ", ") + fmt::format("{}", m.table);
  std::vector<Manifest> chosen;
  for (const std::string& item : split_list(tables)) {
    const Result<long long> number = parse_integer(item);
    const auto found =
        std::find_if(all.begin(), all.end(), [&](const Manifest& m) { return number && m.table == *number; });
    if (found == all.end())
      return Error{
          fmt::format("there is no table '{}' in this version", item), "choose from " + known, {}, 0};
    const bool twice =
        std::any_of(chosen.begin(), chosen.end(), [&](const Manifest& m) { return m.table == found->table; });
    if (!twice) chosen.push_back(*found);
  }
  return chosen;
}

}  // namespace palpate::experiments
