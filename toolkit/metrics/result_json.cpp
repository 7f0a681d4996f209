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
  void operator()(const char* key, const Interval& value) const {
    to[key] = std::isfinite(value.low) && std::isfinite(value.high) ? Json::array({value.low, value.high})
                                                                    : Json(nullptr);
  }
  void operator()(const char* key, bool value) const { to[key] = value; }
  void operator()(const char* key, std::uint64_t value) const { to[key] = value; }
  void operator()(const char* key, int value) const { to[key] = value; }
  void operator()(const char* key, const std::string& value) const { to[key] = value; }
  template <class T>
  void later(const char* key, const T& value) const {
    (*this)(key, value);
  }
};

// Empty text becomes null.
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
constexpr auto kStream = [](auto&& v, auto& s) { visit_stream(v, s); };
constexpr auto kTruth = [](auto&& v, auto& s) { visit_truth(v, s); };
constexpr auto kScoring = [](auto&& v, auto& s) { visit_scoring(v, s); };
constexpr auto kTiming = [](auto&& v, auto& s) { visit_timing(v, s); };
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
  if (r.prepare_clock) visit_prepare_clock(Writer{prepare}, *r.prepare_clock);
  prepare["phases"] = std::move(phases);
  prepare["notes"] = r.prepare->notes;
  prepare["warnings"] = r.prepare->warnings;
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
  j["role"] = render::name_of(r.role);
  j["works_on"] = render::name_of(r.works_on);
  j["missing"] = r.missing;
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
  j["timing"] = object_or_null(r.timing, kTiming);
  j["frame"] = object_or_null(r.frame, kStatistics);
  j["frame_free"] = object_or_null(r.frame_free, kStatistics);
  j["frame_all"] = object_or_null(r.frame_all, kStatistics);
  j["frame_paced"] = nullptr;
  if (r.paced || r.paced_evicted) {
    j["frame_paced"] = Json::object();
    j["frame_paced"]["plain"] = object_or_null(r.paced, kPaced);
    j["frame_paced"]["evicted"] = object_or_null(r.paced_evicted, kPaced);
  }
  j["accuracy"] = object_or_null(r.accuracy, kAccuracy);
  j["energy"] = object_or_null(r.energy, kEnergy);
  j["stream"] = object_or_null(r.stream, kStream);
  if (r.stream) j["stream"]["swaps_s"] = r.stream->swaps_s;
  j["trace_hash"] = text_or_null(r.trace_hash);
  j["files"] = {{"trace", text_or_null(r.trace_file)}, {"scores", text_or_null(r.scores_file)}};
  return j;
}

Json conditions_of(const ResultDocument& document) {
  if (!document.conditions) return nullptr;
  Json j = Json::object();
  visit_conditions(Writer{j}, *document.conditions);
  j["libraries"] = Json::object();
  for (const auto& [name, version] : document.conditions->libraries) j["libraries"][name] = version;
  return j;
}

void write_study(const ResultDocument& document, Json& j) {
  j["models"] = Json::array();
  for (const StudyModel& model : document.models) {
    Json& one = j["models"].emplace_back(Json::object());
    visit_model(Writer{one}, model);
    one["sample"] = text_or_null(model.sample);
  }
  j["truth"] = object_or_null(document.truth, kTruth);
  j["scoring"] = object_or_null(document.scoring, kScoring);
  if (!document.scoring) return;
  j["scoring"]["felt_stiffness_n_per_mm"] = document.scoring->felt_stiffness_n_per_mm;
  j["scoring"]["forces_comparable"] = document.scoring->forces_comparable;
}

// ---- reading

// Collects the first fault; later ones are consequences.
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
    if (found == nullptr || found->is_null()) return;  // was not finite: keeps the default
    if (!found->is_number()) return fail(key, "is not a number");
    value = found->get<double>();
  }
  void operator()(const char* key, Interval& value) const {
    const Json* found = find(key);
    if (found == nullptr) return;
    if (!found->is_array() || found->size() != 2 || !(*found)[0].is_number() || !(*found)[1].is_number())
      return fail(key, "is not a pair of numbers");
    value = {(*found)[0].get<double>(), (*found)[1].get<double>()};
  }
  void operator()(const char* key, bool& value) const {
    const Json* found = find(key);
    if (found == nullptr) return;
    if (!found->is_boolean()) return fail(key, "is neither true nor false");
    value = found->get<bool>();
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
  // A key that earlier documents lack.
  template <class T>
  void later(const char* key, T& value) const {
    if (from.contains(key)) (*this)(key, value);
  }
  void sentences(const char* key, std::vector<std::string>& list) const {
    const auto found = from.find(key);
    if (found == from.end()) return;
    if (!found->is_array()) return fail(key, "is not a list");
    for (const Json& one : *found) {
      if (!one.is_string()) return fail(key, "holds something that is not a text");
      list.push_back(one.get<std::string>());
    }
  }
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
  if (prepare->contains("wall_ms")) visit_prepare_clock(inside, r.prepare_clock.emplace());
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
  inside.sentences("notes", r.prepare->notes);
  inside.sentences("warnings", r.prepare->warnings);
  const Json* memory = in.object("memory");
  std::uint64_t bytes = 0;
  if (memory != nullptr) in.inside(*memory, "memory")("bytes", bytes);
  r.prepare->bytes = bytes;
}

constexpr std::array kRoles = {render::Role::kOurs, render::Role::kLiteral, render::Role::kRival,
                               render::Role::kReference, render::Role::kOracle};
constexpr std::array kGeometries = {render::Geometry::kPoints, render::Geometry::kMesh,
                                    render::Geometry::kHeights, render::Geometry::kFormula,
                                    render::Geometry::kImages};

/// The value of this name, or nothing.
template <class Enum, std::size_t n>
std::optional<Enum> named(const std::array<Enum, n>& all, std::string_view name) {
  for (const Enum one : all)
    if (render::name_of(one) == name) return one;
  return std::nullopt;
}

/// Keys that earlier documents lack.
void read_capabilities(const Reader& in, RendererResult& r) {
  std::string role, works_on;
  in.later("role", role);
  in.later("works_on", works_on);
  in.sentences("missing", r.missing);
  if (const std::optional<render::Role> known = named(kRoles, role))
    r.role = *known;
  else if (!role.empty())
    in.fail("role", "is none of ours, literal, rival, reference, oracle");
  if (const std::optional<render::Geometry> known = named(kGeometries, works_on))
    r.works_on = *known;
  else if (!works_on.empty())
    in.fail("works_on", "is none of points, mesh, heights, formula");
}

void read_files(const Reader& in, RendererResult& r) {
  if (!in.from.contains("files")) return;
  const Json* files = in.object("files");
  if (files == nullptr) return;
  const Reader inside = in.inside(*files, "files");
  inside("trace", r.trace_file);
  inside("scores", r.scores_file);
}

void read_numbers(const Reader& in, const char* key, std::vector<double>& into) {
  const Json* list = in.find(key);
  if (list != nullptr && !list->is_array()) return in.fail(key, "is not a list");
  for (std::size_t i = 0; list != nullptr && i < list->size(); ++i) {
    if (!(*list)[i].is_number()) return in.fail(key, "holds something that is no number");
    into.push_back((*list)[i].get<double>());
  }
}

void read_scoring(const Reader& in, ScoreBasis& s) {
  visit_scoring(in, s);
  read_numbers(in, "felt_stiffness_n_per_mm", s.felt_stiffness_n_per_mm);
  const Json* comparable = in.find("forces_comparable");
  if (comparable != nullptr && !comparable->is_boolean())
    return in.fail("forces_comparable", "is neither true nor false");
  if (comparable != nullptr) s.forces_comparable = comparable->get<bool>();
}

/// The study's keys, which earlier documents lack.
void read_study(const Reader& in, ResultDocument& document) {
  if (in.from.contains("truth")) in.part("truth", document.truth, kTruth);
  if (in.from.contains("scoring"))
    in.part("scoring", document.scoring,
            [](const Reader& inside, ScoreBasis& s) { read_scoring(inside, s); });
  const auto models = in.from.find("models");
  if (models == in.from.end()) return;
  if (!models->is_array()) return in.fail("models", "is not a list");
  for (const Json& model : *models) {
    if (!model.is_object()) return in.fail("models", "holds something that is not an object");
    const Reader inside = in.inside(model, "models[]");
    StudyModel& one = document.models.emplace_back();
    visit_model(inside, one);
    inside("sample", one.sample);
  }
}

void read_conditions(const Reader& in, ResultDocument& document) {
  if (!in.from.contains("conditions")) return;
  in.part("conditions", document.conditions, [](const Reader& inside, MeasurementConditions& c) {
    visit_conditions(inside, c);
    const Json* libraries = inside.object("libraries");
    if (libraries == nullptr) return;
    for (const auto& [name, version] : libraries->items()) {
      if (!version.is_string()) return inside.fail("libraries", "holds a version that is not a text");
      c.libraries.emplace_back(name, version.get<std::string>());
    }
  });
}

void read_renderer(const Reader& in, RendererResult& r) {
  in("label", r.label);
  in("name", r.name);
  in("reason", r.reason);
  in("threads", r.threads);
  in("trace_hash", r.trace_hash);
  read_capabilities(in, r);
  read_files(in, r);
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
  if (in.from.contains("timing")) in.part("timing", r.timing, kTiming);
  in.part("frame", r.frame, kStatistics);
  if (in.from.contains("frame_free")) in.part("frame_free", r.frame_free, kStatistics);
  in.part("frame_all", r.frame_all, kStatistics);
  if (const Json* paced = in.object("frame_paced")) {
    const Reader inside = in.inside(*paced, "frame_paced");
    inside.part("plain", r.paced, kPaced);
    inside.part("evicted", r.paced_evicted, kPaced);
  }
  in.part("accuracy", r.accuracy, kAccuracy);
  in.part("energy", r.energy, kEnergy);
  if (in.from.contains("stream")) in.part("stream", r.stream, kStream);
  if (r.stream) read_numbers(in.inside(*in.object("stream"), "stream"), "swaps_s", r.stream->swaps_s);
}

void write_head(const DocumentHead& head, Json& j) {
  const Writer top{j};
  top("version", head.version);
  top("commit", head.commit);
  top("build", head.build);
  j["machine"] = Json::object();
  kMachine(Writer{j["machine"]}, head.machine);
  top("started_utc", head.started_utc);
  top("command", head.command);
}

}  // namespace

std::string head_json(const DocumentHead& head) {
  Json j = Json::object();
  write_head(head, j);
  return j.dump(kIndent, ' ', false, Json::error_handler_t::replace);
}

std::string to_json(const ResultDocument& document) {
  Json j = Json::object();
  const Writer top{j};
  top("schema", document.schema);
  write_head(document, j);
  j["title"] = text_or_null(document.title);
  j["about"] = text_or_null(document.about);
  top("scene", document.scene);
  top("path", document.path);
  j["path_hash"] = text_or_null(document.path_hash);
  j["conditions"] = conditions_of(document);
  write_study(document, j);
  j["warnings"] = document.warnings;
  j["notes"] = document.notes;
  j["complete"] = document.complete;
  j["trace_hash_name"] = "fnv1a64";
  j["renderers"] = Json::array();
  for (const RendererResult& r : document.renderers) j["renderers"].push_back(renderer_of(r));
  // Invalid UTF-8 in file names becomes replacement characters instead of an exception.
  return j.dump(kIndent, ' ', false, Json::error_handler_t::replace) + "\n";
}

Result<ResultDocument> parse_result(std::string_view json, std::string_view source) {
  const std::string file(source);
  const Json j = Json::parse(json.begin(), json.end(), nullptr, false);
  if (j.is_discarded() || !j.is_object())
    return Error{"this is not a JSON object", "give a result.json that palpate wrote", file};
  ResultDocument document;
  std::string wrong;
  const Reader top{j, "", wrong};
  top("schema", document.schema);
  if (wrong.empty() && document.schema != kResultSchema && document.schema != kFormerResultSchema)
    return Error{"the schema is '" + document.schema + "', this program reads '" + kResultSchema + "'",
                 "run the experiment again with this version", file};
  top("version", document.version);
  top("commit", document.commit);
  top("build", document.build);
  if (const Json* machine = top.object("machine"))
    kMachine(top.inside(*machine, "machine"), document.machine);
  top("scene", document.scene);
  top("path", document.path);
  top("started_utc", document.started_utc);
  top.later("command", document.command);
  top.later("title", document.title);
  top.later("about", document.about);
  top.later("path_hash", document.path_hash);
  read_conditions(top, document);
  read_study(top, document);
  top.sentences("warnings", document.warnings);
  top.sentences("notes", document.notes);
  // Earlier documents lack it: they were written complete.
  if (j.contains("complete") && !j["complete"].is_boolean())
    top.fail("complete", "is neither true nor false");
  if (wrong.empty()) document.complete = j.value("complete", true);
  const Json* renderers = top.find("renderers");
  if (renderers != nullptr && !renderers->is_array()) top.fail("renderers", "is not a list");
  for (std::size_t i = 0; wrong.empty() && renderers != nullptr && i < renderers->size(); ++i) {
    const Json& one = (*renderers)[i];
    const std::string key = "renderers[" + std::to_string(i) + "]";
    if (one.is_object())
      read_renderer(top.inside(one, key), document.renderers.emplace_back());
    else
      top.fail(key.c_str(), "is not an object");
  }
  if (!wrong.empty()) return Error{wrong, "give a result.json that palpate wrote", file};
  return document;
}

}  // namespace palpate::metrics
