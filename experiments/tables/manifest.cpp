#include "experiments/tables/manifest.h"

#include <fmt/format.h>

#include <algorithm>
#include <tuple>

#include <palpate/options.h>
#include <palpate/result.h>
#include "toolkit/core/files.h"
#include "toolkit/scene/toml_fields.h"

namespace palpate::experiments {
namespace {

using scene::Field;
using scene::field;
using Fields = std::vector<Field>;

template <class T>
Field tables(const std::string& key, std::vector<T>& into, const std::string& kind);

constexpr const char* kKinds[] = {"frames",     "neighbours", "methods",    "meshes", "growth",
                                  "behaviours", "ladder",     "off-vertex", "scanner"};
const std::vector<std::string> kProtocols = {"ladder", "off-vertex", "scanner"};

std::vector<std::string> and_protocols(std::vector<std::string> kinds) {
  kinds.insert(kinds.end(), kProtocols.begin(), kProtocols.end());
  return kinds;
}

Fields fields_of(ManifestModel& m, const std::string& /*kind*/) {
  return {field("name", m.name).must(),
          field("scene", m.scene),
          field("generate", m.generate),
          field("scan", m.scan),
          field("stand_in", m.stand_in),
          field("quick", m.quick),
          field("unit", m.unit),
          field("scale", m.scale),
          field("path", m.path).of({"methods"}),
          field("full", m.full).of(and_protocols({"methods"})),
          field("sample", m.sample).of(kProtocols),
          field("quick_sample", m.quick_sample).of(kProtocols),
          field("reference", m.reference).of(kProtocols),
          field("seeds", m.seeds).of(kProtocols),
          field("long", m.long_run).of({"growth"}),
          field("printed_min", m.printed_min).of({"neighbours"}),
          field("slow", m.slow).of({"neighbours", "methods"}),
          field("only", m.only).of({"methods"}),
          field("in_time", m.in_time).of({"meshes"}),
          field("points_in_time", m.points_in_time).of({"meshes"})};
}

Fields fields_of(ManifestMethod::Published& p, const std::string& /*kind*/) {
  return {field("points", p.points).must(), field("us", p.us).must()};
}

Fields fields_of(ManifestMethod& m, const std::string& kind) {
  return {field("renderer", m.renderer).must(),
          field("label", m.label),
          field("kin", m.kin),
          field("preparation", m.preparation),
          field("broad", m.broad),
          field("narrow", m.narrow),
          field("response", m.response),
          tables<ManifestMethod::Published>("published", m.published, kind)};
}

Fields fields_of(PrintedMesh& p, const std::string& /*kind*/) {
  return {field("method", p.method).must(),
          field("model", p.model),
          field("time", p.time),
          field("minutes", p.minutes),
          field("machine", p.machine),
          field("kin", p.kin),
          field("ours", p.ours)};
}

Fields fields_of(ManifestRun& r, const std::string& /*kind*/) {
  return {field("renderer", r.renderer).must(), field("quick", r.quick)};
}

Fields fields_of(Manifest& m, const std::string& kind) {
  const std::vector<std::string> printed = {"frames", "neighbours", "methods", "meshes"};
  const std::vector<std::string> on_models =
      and_protocols({"frames", "neighbours", "methods", "meshes", "growth"});
  const std::vector<std::string> along = and_protocols({"frames", "methods", "growth"});
  std::string& read_before = m.kind_name;
  return {field("kind", read_before).must(),
          field("table", m.table).must().of(printed),
          field("title", m.title).must(),
          field("text", m.text),
          field("notes", m.notes),
          field("walls", m.wall_spacings).of({"neighbours"}),
          field("paced", m.paced).of({"frames"}),
          scene::inner("printed",
                       {field("hardware", m.hardware), field("points", m.printed_points).of({"frames"}),
                        field("frames", m.printed_frames).of({"frames"}),
                        field("min_ms", m.printed_min_ms).of({"frames"}),
                        field("max_ms", m.printed_max_ms).of({"frames"}),
                        field("mean_ms", m.printed_mean_ms).of({"frames"})},
                       kind)
              .of(printed),
          scene::inner("path",
                       {field("spec", m.path).must(), field("quick", m.quick_path),
                        field("scan", m.scan_path).of({"frames"}),
                        field("contact_frames", m.contact_frames).of({"frames"})},
                       kind)
              .of(along),
          tables<ManifestModel>("model", m.models, kind).must().of(on_models),
          tables<ManifestMethod>("method", m.methods, kind).must().of({"methods"}),
          tables<PrintedMesh>("printed_mesh", m.printed_meshes, kind).of({"meshes"}),
          tables<ManifestRun>("run", m.runs, kind).of(and_protocols({"frames", "growth", "behaviours"}))};
}

template <class T>
Field tables(const std::string& key, std::vector<T>& into, const std::string& kind) {
  return scene::list<T>(
      key, into, [](T& one, const std::string& its_kind) { return fields_of(one, its_kind); }, kind);
}

/// The kind decides which other keys are valid.
Result<Manifest::Kind> read_kind(const toml::table& root, const scene::TomlFile& in_file) {
  const toml::node* node = root.get("kind");
  if (node == nullptr)
    return in_file.at(root.source(), "a manifest needs 'kind'",
                      fmt::format("it is one of {}", fmt::join(kKinds, ", ")));
  const std::string kind = node->value_or(std::string());
  const auto* const found = std::find(std::begin(kKinds), std::end(kKinds), kind);
  if (found != std::end(kKinds)) return static_cast<Manifest::Kind>(found - std::begin(kKinds));
  return in_file.at(*node, "there is no kind " + shown(kind),
                    did_you_mean(kind, {std::begin(kKinds), std::end(kKinds)},
                                 fmt::format("it is one of {}", fmt::join(kKinds, ", "))));
}

/// A user's manifest, named after its file.
Result<Manifest> manifest_of_file(const std::string& file) {
  Result<std::string> text = read_file(file, kMemoryLimitBytes);
  if (!text) return std::move(text).error();
  return parse_manifest(*text, file);
}

Result<Manifest> find_manifest(const std::vector<Manifest>& all, const std::string& item) {
  if (item.ends_with(".toml")) return manifest_of_file(item);
  const auto found = std::find_if(all.begin(), all.end(), [&](const Manifest& m) {
    return m.id() == item || (m.table > 0 && fmt::format("{}", m.table) == item);
  });
  if (found != all.end()) return *found;
  std::string known;
  for (const Manifest& m : all)
    known += (known.empty() ? "" : ", ") + (m.table > 0 ? fmt::format("{}", m.table) : m.id());
  return Error{fmt::format("there is no table '{}' in this version", item),
               "choose from " + known + ", or name a manifest (.toml)"};
}

}  // namespace

std::string Manifest::id() const {
  return table > 0 ? fmt::format("table{}", table) : kind_name;
}

Result<Manifest> parse_manifest(std::string_view text, const std::string& name) {
  try {
    const toml::table root = toml::parse(text, name);
    const scene::TomlFile in_file{name};
    const Result<Manifest::Kind> kind = read_kind(root, in_file);
    if (!kind) return kind.error();
    Manifest manifest;
    manifest.kind = *kind;
    manifest.source = text;
    const std::string word = kKinds[static_cast<std::size_t>(*kind)];
    PALPATE_TRY(scene::read_fields(root, fields_of(manifest, word), "a manifest", word, in_file));
    if (const toml::node* number = root.get("table"); number != nullptr && manifest.table == 0)
      return in_file.at(*number, "'table' must be 1 or more");
    return manifest;
  } catch (const toml::parse_error& error) {
    return Error{std::string(error.description()), "a manifest is TOML", name,
                 static_cast<std::int64_t>(error.source().begin.line)};
  }
}

Result<std::vector<Manifest>> manifests_for(const std::string& tables) {
  std::vector<Manifest> all;
  for (const EmbeddedManifest& embedded : embedded_manifests()) {
    Result<Manifest> manifest = parse_manifest(embedded.text, embedded.name);
    if (!manifest) return std::move(manifest).error();
    all.push_back(*std::move(manifest));
  }
  // Manifests without a table come last, by name.
  std::sort(all.begin(), all.end(), [](const Manifest& a, const Manifest& b) {
    return std::tuple(a.table == 0, a.table, a.id()) < std::tuple(b.table == 0, b.table, b.id());
  });
  if (tables.empty()) return all;
  std::vector<Manifest> chosen;
  for (const std::string& item : split_list(tables)) {
    Result<Manifest> found = find_manifest(all, item);
    if (!found) return std::move(found).error();
    const auto same =
        std::find_if(chosen.begin(), chosen.end(), [&](const Manifest& m) { return m.id() == found->id(); });
    if (same == chosen.end())
      chosen.push_back(*std::move(found));
    else if (same->source != found->source)
      return Error{fmt::format("two manifests are of {}", found->id()), "run them one after the other"};
  }
  return chosen;
}

}  // namespace palpate::experiments
