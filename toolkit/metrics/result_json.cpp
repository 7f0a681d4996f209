#include "toolkit/metrics/result_json.h"

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "toolkit/metrics/result_keys.h"

namespace palpate::metrics {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kIndent = 2;
constexpr std::array<const char*, 3> kStatusNames = {"ok", "did-not-finish", "failed"};

// ---- writing

struct Writer {
  Json& to;
  template <class T>
  void operator()(const char* key, const std::optional<T>& value) const {
    if (value) {
      (*this)(key, *value);
    } else {
      to[key] = nullptr;
    }
  }
  void operator()(const char* key, double value) const {
    if (std::isfinite(value)) {
      to[key] = value;
    } else {
      to[key] = nullptr;
    }
  }
  void operator()(const char* key, std::uint64_t value) const { to[key] = value; }
  void operator()(const char* key, int value) const { to[key] = value; }
  void operator()(const char* key, const std::string& value) const { to[key] = value; }
};

// Text that is never empty in a document: empty means null.
Json text_or_null(const std::string& text) {
  return text.empty() ? Json(nullptr) : Json(text);
}

template <class T, class Visit>
Json object_or_null(const std::optional<T>& value, Visit visit) {
  if (!value) return nullptr;
  Json object = Json::object();
  visit(Writer{object}, *value);
  return object;
}

constexpr auto kStatistics = [](auto&& v, auto& s) { visit_statistics(v, s); };
constexpr auto kPaced = [](auto&& v, auto& s) { visit_paced(v, s); };
constexpr auto kAccuracy = [](auto&& v, auto& s) { visit_accuracy(v, s); };
constexpr auto kEnergy = [](auto&& v, auto& s) { visit_energy(v, s); };
constexpr auto kMachine = [](auto&& v, auto& s) { visit_machine(v, s); };

Json prepare_of(const RendererResult& r) {
  if (!r.prepare) return nullptr;
  Json phases = Json::array();
  for (const render::PreparePhase& phase : r.prepare->phases) {
    Json one = Json::object();
    Writer{one}("name", phase.name);
    Writer{one}("ms", phase.ms);
    phases.push_back(std::move(one));
  }
  Json prepare = Json::object();
  Writer{prepare}("total_ms", r.prepare->total_ms);
  prepare["phases"] = std::move(phases);
  prepare["notes"] = r.prepare->notes;
  return prepare;
}

Json memory_of(const RendererResult& r) {
  if (!r.prepare) return nullptr;
  Json memory = Json::object();
  memory["bytes"] = r.prepare->bytes;
  memory["bytes_per_point"] = nullptr;
  if (r.model && r.model->points > 0)
    memory["bytes_per_point"] = static_cast<double>(r.prepare->bytes) / static_cast<double>(r.model->points);
  return memory;
}

Json renderer_of(const RendererResult& r) {
  Json j = Json::object();
  j["label"] = r.label;
  j["name"] = r.name;
  j["options"] = Json::object();
  for (const auto& [key, value] : r.options) j["options"][key] = value;
  j["status"] = kStatusNames[static_cast<std::size_t>(r.status)];
  j["reason"] = text_or_null(r.reason);
  j["model"] = nullptr;
  if (r.model) {
    j["model"] = Json::object();
    j["model"]["points"] = r.model->points;
    Writer{j["model"]}("resolution_mm", r.model->resolution_mm);
  }
  j["prepare"] = prepare_of(r);
  j["memory"] = memory_of(r);
  j["threads"] = r.threads;
  j["frame"] = object_or_null(r.frame, kStatistics);
  j["frame_all"] = object_or_null(r.frame_all, kStatistics);
  j["frame_paced"] = nullptr;
  if (r.paced || r.paced_evicted) {
    j["frame_paced"] = Json::object();
    j["frame_paced"]["plain"] = object_or_null(r.paced, kPaced);
    j["frame_paced"]["evicted"] = object_or_null(r.paced_evicted, kPaced);
  }
  j["accuracy"] = object_or_null(r.accuracy, kAccuracy);
  j["energy"] = object_or_null(r.energy, kEnergy);
  j["trace_hash"] = text_or_null(r.trace_hash);
  return j;
}

// ---- reading

// Collects the first thing that is wrong; later ones are consequences of it.
struct Reader {
  const Json& from;
  std::string where;
  std::string& wrong;

  [[nodiscard]] const Json* find(const char* key) const {
    const auto found = from.find(key);
    if (found == from.end()) {
      fail(key, "is missing");
      return nullptr;
    }
    return &*found;
  }
  void fail(const char* key, const char* how) const {
    if (wrong.empty()) wrong = "the key " + where + key + " " + how;
  }
  template <class T>
  void operator()(const char* key, std::optional<T>& value) const {
    value.reset();
    const Json* found = find(key);
    if (found == nullptr || found->is_null()) return;
    T inner{};
    (*this)(key, inner);
    value = std::move(inner);
  }
  void operator()(const char* key, double& value) const {
    const Json* found = find(key);
    if (found == nullptr || found->is_null()) return;  // it was not finite: the default stays
    if (!found->is_number()) return fail(key, "is not a number");
    value = found->get<double>();
  }
  void operator()(const char* key, std::uint64_t& value) const {
    const Json* found = find(key);
    if (found == nullptr) return;
    if (!found->is_number_unsigned()) return fail(key, "is not a count");
    value = found->get<std::uint64_t>();
  }
  void operator()(const char* key, int& value) const {
    std::uint64_t count = 0;
    (*this)(key, count);
    constexpr std::uint64_t kMost = 1u << 20;  // threads and cores
    if (count > kMost) return fail(key, "is too large");
    value = static_cast<int>(count);
  }
  void operator()(const char* key, std::string& value) const {
    const Json* found = find(key);
    if (found == nullptr || found->is_null()) return;
    if (!found->is_string()) return fail(key, "is not a text");
    value = found->get<std::string>();
  }
  // The object under `key`, or nothing where it is null.
  [[nodiscard]] const Json* object(const char* key) const {
    const Json* found = find(key);
    if (found == nullptr || found->is_null()) return nullptr;
    if (found->is_object()) return found;
    fail(key, "is not an object");
    return nullptr;
  }
  [[nodiscard]] Reader inside(const Json& object, const std::string& key) const {
    return {object, where + key + ".", wrong};
  }
  template <class T, class Visit>
  void part(const char* key, std::optional<T>& value, Visit visit) const {
    const Json* found = object(key);
    if (found != nullptr) visit(inside(*found, key), value.emplace());
  }
};

void read_prepare(const Reader& in, RendererResult& r) {
  const Json* prepare = in.object("prepare");
  if (prepare == nullptr) return;
  const Reader inside = in.inside(*prepare, "prepare");
  r.prepare.emplace();
  inside("total_ms", r.prepare->total_ms);
  const Json* phases = inside.find("phases");
  if (phases != nullptr && !phases->is_array()) inside.fail("phases", "is not a list");
  if (phases != nullptr && phases->is_array()) {
    for (const Json& phase : *phases) {
      if (!phase.is_object()) return inside.fail("phases", "holds something that is not an object");
      const Reader one = inside.inside(phase, "phases[]");
      one("name", r.prepare->phases.emplace_back().name);
      one("ms", r.prepare->phases.back().ms);
    }
  }
  const auto notes = prepare->find("notes");
  if (notes != prepare->end() && notes->is_array()) {
    for (const Json& note : *notes) {
      if (note.is_string()) r.prepare->notes.push_back(note.get<std::string>());
    }
  }
  const Json* memory = in.object("memory");
  std::uint64_t bytes = 0;
  if (memory != nullptr) in.inside(*memory, "memory")("bytes", bytes);
  r.prepare->bytes = bytes;
}

void read_renderer(const Reader& in, RendererResult& r) {
  in("label", r.label);
  in("name", r.name);
  in("reason", r.reason);
  in("threads", r.threads);
  in("trace_hash", r.trace_hash);
  std::string status;
  in("status", status);
  std::size_t known = 0;
  while (known < kStatusNames.size() && status != kStatusNames[known]) ++known;
  if (known == kStatusNames.size()) return in.fail("status", "is none of ok, did-not-finish, failed");
  r.status = static_cast<RunStatus>(known);
  if (const Json* options = in.object("options")) {
    for (const auto& [key, value] : options->items()) {
      if (!value.is_string()) return in.fail("options", "holds a value that is not a text");
      r.options.emplace_back(key, value.get<std::string>());
    }
  }
  in.part("model", r.model, [](const Reader& model, RendererResult::Model& m) {
    model("points", m.points);
    model("resolution_mm", m.resolution_mm);
  });
  read_prepare(in, r);
  in.part("frame", r.frame, kStatistics);
  in.part("frame_all", r.frame_all, kStatistics);
  if (const Json* paced = in.object("frame_paced")) {
    const Reader inside = in.inside(*paced, "frame_paced");
    inside.part("plain", r.paced, kPaced);
    inside.part("evicted", r.paced_evicted, kPaced);
  }
  in.part("accuracy", r.accuracy, kAccuracy);
  in.part("energy", r.energy, kEnergy);
}

}  // namespace

void RendererResult::take(const trace::ReplayReport& report) {
  frame = report.contact;
  frame_all = report.all;
  paced = report.paced;
  paced_evicted = report.paced_evicted;
  trace_hash = report.trace_hash;
}

std::string to_json(const ResultDocument& document) {
  Json j = Json::object();
  const Writer top{j};
  top("schema", document.schema);
  top("version", document.version);
  top("commit", document.commit);
  top("build", document.build);
  j["machine"] = Json::object();
  kMachine(Writer{j["machine"]}, document.machine);
  top("scene", document.scene);
  top("path", document.path);
  top("started_utc", document.started_utc);
  top("command", document.command);
  j["trace_hash_name"] = "fnv1a64";
  j["renderers"] = Json::array();
  for (const RendererResult& r : document.renderers) j["renderers"].push_back(renderer_of(r));
  // File names may hold bytes that are no UTF-8: they become replacement characters instead of an exception.
  return j.dump(kIndent, ' ', false, Json::error_handler_t::replace) + "\n";
}

Result<ResultDocument> parse_result(std::string_view json, std::string_view source) {
  const std::string file(source);
  const Json j = Json::parse(json.begin(), json.end(), nullptr, false);
  if (j.is_discarded() || !j.is_object())
    return Error{"this is not a JSON object", "give a result.json that palpate wrote", file, 0};
  ResultDocument document;
  std::string wrong;
  const Reader top{j, "", wrong};
  top("schema", document.schema);
  if (wrong.empty() && document.schema != kResultSchema)
    return Error{"the schema is '" + document.schema + "', this program reads '" + kResultSchema + "'",
                 "run the experiment again with this version", file, 0};
  top("version", document.version);
  top("commit", document.commit);
  top("build", document.build);
  if (const Json* machine = top.object("machine"))
    kMachine(top.inside(*machine, "machine"), document.machine);
  top("scene", document.scene);
  top("path", document.path);
  top("started_utc", document.started_utc);
  if (j.contains("command")) top("command", document.command);
  const Json* renderers = top.find("renderers");
  if (renderers != nullptr && !renderers->is_array()) top.fail("renderers", "is not a list");
  for (std::size_t i = 0; wrong.empty() && renderers != nullptr && i < renderers->size(); ++i) {
    const Json& one = (*renderers)[i];
    const std::string key = "renderers[" + std::to_string(i) + "]";
    if (!one.is_object()) {
      top.fail(key.c_str(), "is not an object");
    } else {
      read_renderer(top.inside(one, key), document.renderers.emplace_back());
    }
  }
  if (!wrong.empty()) return Error{wrong, "give a result.json that palpate wrote", file, 0};
  return document;
}

}  // namespace palpate::metrics
