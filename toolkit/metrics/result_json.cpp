#include "toolkit/metrics/result_json.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <type_traits>

#include "toolkit/core/messages.h"
#include "toolkit/metrics/result_keys.h"

namespace palpate::metrics {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kIndent = 2;

using render::name_of;

std::string_view name_of(RunStatus status) noexcept {
  constexpr std::array<const char*, 3> kNames = {"ok", "did-not-finish", "failed"};
  return kNames[static_cast<std::size_t>(status)];
}
constexpr std::array kStatuses = {RunStatus::kOk, RunStatus::kDidNotFinish, RunStatus::kFailed};
constexpr std::array kRoles = {render::Role::kOurs, render::Role::kLiteral, render::Role::kRival,
                               render::Role::kReference, render::Role::kOracle};
constexpr std::array kGeometries = {render::Geometry::kPoints, render::Geometry::kMesh,
                                    render::Geometry::kHeights, render::Geometry::kFormula,
                                    render::Geometry::kImages};

// Beyond what result_keys.h asks of a visitor, both understand texts that may be empty, lists, objects and
// names. has(key) is always true of a Writer, and of a Reader where the document has the key.

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
  [[nodiscard]] static bool has(const char*) noexcept { return true; }
  /// Empty text becomes null.
  void text(const char* key, const std::string& value) const {
    to[key] = value.empty() ? Json(nullptr) : Json(value);
  }
  void fixed(const char* key, const char* value) const { to[key] = value; }
  void sentences(const char* key, const std::vector<std::string>& list) const { to[key] = list; }
  void numbers(const char* key, const std::vector<double>& list) const { to[key] = list; }
  void pairs(const char* key, const std::vector<std::pair<std::string, std::string>>& list) const {
    Json& object = to[key] = Json::object();
    for (const auto& [name, value] : list) object[name] = value;
  }
  template <class Enum, std::size_t n>
  void name(const char* key, Enum value, const std::array<Enum, n>&) const {
    to[key] = name_of(value);
  }
  /// An object, or null unless `there`.
  template <class Visit>
  void group(const char* key, bool there, Visit&& visit) const {
    Json object = there ? Json::object() : Json(nullptr);
    if (there) visit(Writer{object});
    to[key] = std::move(object);
  }
  template <class T, class Visit>
  void part(const char* key, const std::optional<T>& value, Visit&& visit) const {
    group(key, value.has_value(), [&](const Writer& inside) { visit(inside, *value); });
  }
  /// The keys of a value that may be missing, from `first` on, among this object's.
  template <class T, class Visit>
  void among(const char* /*first*/, const std::optional<T>& value, Visit&& visit) const {
    if (value) visit(*this, *value);
  }
  template <class T, class Visit>
  void parts(const char* key, const std::vector<T>& list, Visit&& visit) const {
    Json& array = to[key] = Json::array();
    for (const T& one : list) visit(Writer{array.emplace_back(Json::object())}, one);
  }
};

// Collects the first fault; later ones are consequences.
struct Reader {
  const Json& from;
  std::string where;
  std::string& wrong;

  void fail(const std::string& key, const std::string& how) const {
    if (wrong.empty()) wrong = "the key " + where + key + " " + how;
  }
  [[nodiscard]] bool has(const char* key) const { return from.contains(key); }
  [[nodiscard]] const Json* find(const char* key) const {
    const auto found = from.find(key);
    if (found != from.end()) return &*found;
    fail(key, "is missing");
    return nullptr;
  }
  /// The value where it is of the kind that `is` tells.
  [[nodiscard]] const Json* find(const char* key, bool (Json::*is)() const noexcept, const char* how) const {
    const Json* found = find(key);
    if (found == nullptr || (found->*is)()) return found;
    fail(key, how);
    return nullptr;
  }
  /// The same, where null stands for no value.
  [[nodiscard]] const Json* find_or_null(const char* key, bool (Json::*is)() const noexcept,
                                         const char* how) const {
    const auto found = from.find(key);
    return found != from.end() && found->is_null() ? nullptr : find(key, is, how);
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
  // A number that was not finite keeps the default.
  void operator()(const char* key, double& value) const {
    if (const Json* found = find_or_null(key, &Json::is_number, "is not a number"))
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
    if (const Json* found = find(key, &Json::is_boolean, "is neither true nor false"))
      value = found->get<bool>();
  }
  void operator()(const char* key, std::uint64_t& value) const {
    if (const Json* found = find(key, &Json::is_number_unsigned, "is not a count"))
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
    if (const Json* found = find_or_null(key, &Json::is_string, "is not a text"))
      value = found->get<std::string>();
  }
  // A key that earlier documents lack.
  template <class T>
  void later(const char* key, T& value) const {
    if (has(key)) (*this)(key, value);
  }
  void text(const char* key, std::string& value) const { (*this)(key, value); }
  void fixed(const char*, const char*) const noexcept {}
  void sentences(const char* key, std::vector<std::string>& list) const {
    const Json* found = has(key) ? find(key, &Json::is_array, "is not a list") : nullptr;
    for (std::size_t i = 0; found != nullptr && i < found->size(); ++i) {
      if (!(*found)[i].is_string()) return fail(key, "holds something that is not a text");
      list.push_back((*found)[i].get<std::string>());
    }
  }
  void numbers(const char* key, std::vector<double>& list) const {
    const Json* found = find(key, &Json::is_array, "is not a list");
    for (std::size_t i = 0; found != nullptr && i < found->size(); ++i) {
      if (!(*found)[i].is_number()) return fail(key, "holds something that is no number");
      list.push_back((*found)[i].get<double>());
    }
  }
  void pairs(const char* key, std::vector<std::pair<std::string, std::string>>& list) const {
    const Json* found = find_or_null(key, &Json::is_object, "is not an object");
    if (found == nullptr) return;
    for (const auto& [name, value] : found->items()) {
      if (!value.is_string()) return fail(key, "holds a value that is not a text");
      list.emplace_back(name, value.get<std::string>());
    }
  }
  template <class Enum, std::size_t n>
  void name(const char* key, Enum& value, const std::array<Enum, n>& all) const {
    std::string given;
    (*this)(key, given);
    const auto found = std::find_if(all.begin(), all.end(), [&](Enum one) { return name_of(one) == given; });
    if (found != all.end()) {
      value = *found;
      return;
    }
    std::vector<std::string> names;
    for (const Enum one : all) names.emplace_back(name_of(one));
    fail(key, "is none of " + joined(names));
  }
  template <class Visit>
  void group(const char* key, bool /*there*/, Visit&& visit) const {
    if (const Json* found = find_or_null(key, &Json::is_object, "is not an object"))
      visit(Reader{*found, where + key + ".", wrong});
  }
  template <class T, class Visit>
  void part(const char* key, std::optional<T>& value, Visit&& visit) const {
    group(key, true, [&](const Reader& inside) { visit(inside, value.emplace()); });
  }
  template <class T, class Visit>
  void among(const char* first, std::optional<T>& value, Visit&& visit) const {
    if (has(first)) visit(*this, value.emplace());
  }
  template <class T, class Visit>
  void parts(const char* key, std::vector<T>& list, Visit&& visit) const {
    const Json* found = find(key, &Json::is_array, "is not a list");
    for (std::size_t i = 0; found != nullptr && i < found->size(); ++i) {
      const std::string element = key + ("[" + std::to_string(i) + "]");
      if (!(*found)[i].is_object()) return fail(element, "is not an object");
      visit(Reader{(*found)[i], where + element + ".", wrong}, list.emplace_back());
    }
  }
};

constexpr auto kStatistics = [](auto&& v, auto& s) { visit_statistics(v, s); };
constexpr auto kPaced = [](auto&& v, auto& s) { visit_paced(v, s); };

/// The `memory` of a preparation.
struct Memory {
  std::uint64_t bytes = 0;
  std::optional<double> bytes_per_point{};
};

template <class V, class R>
void visit_prepare(V&& v, R& r) {
  v.part("prepare", r.prepare, [&r](auto&& in, auto& prepare) {
    in("total_ms", prepare.total_ms);
    in.among("wall_ms", r.prepare_clock, [](auto&& w, auto& s) { visit_prepare_clock(w, s); });
    in.parts("phases", prepare.phases, [](auto&& one, auto& phase) {
      one("name", phase.name);
      one("ms", phase.ms);
    });
    in.sentences("notes", prepare.notes);
    in.sentences("warnings", prepare.warnings);
  });
  std::optional<Memory> memory;
  if (r.prepare) memory = Memory{r.prepare->bytes, {}};
  if (memory && r.model && r.model->points > 0)
    memory->bytes_per_point = static_cast<double>(memory->bytes) / static_cast<double>(r.model->points);
  v.part("memory", memory, [](auto&& in, auto& m) {
    in("bytes", m.bytes);
    in.later("bytes_per_point", m.bytes_per_point);
  });
  if constexpr (!std::is_const_v<R>)
    if (r.prepare && memory) r.prepare->bytes = memory->bytes;
}

template <class V, class R>
void visit_renderer(V&& v, R& r) {
  v("label", r.label);
  v("name", r.name);
  v.pairs("options", r.options);
  if (v.has("role")) v.name("role", r.role, kRoles);
  if (v.has("works_on")) v.name("works_on", r.works_on, kGeometries);
  v.sentences("missing", r.missing);
  v.name("status", r.status, kStatuses);
  v.text("reason", r.reason);
  v.part("model", r.model, [](auto&& in, auto& model) {
    in("points", model.points);
    in("resolution_mm", model.resolution_mm);
  });
  visit_prepare(v, r);
  v("threads", r.threads);
  if (v.has("timing")) v.part("timing", r.timing, [](auto&& in, auto& s) { visit_timing(in, s); });
  v.part("frame", r.frame, kStatistics);
  if (v.has("frame_free")) v.part("frame_free", r.frame_free, kStatistics);
  v.part("frame_all", r.frame_all, kStatistics);
  v.group("frame_paced", r.paced || r.paced_evicted, [&r](auto&& in) {
    in.part("plain", r.paced, kPaced);
    in.part("evicted", r.paced_evicted, kPaced);
  });
  v.part("accuracy", r.accuracy, [](auto&& in, auto& s) { visit_accuracy(in, s); });
  v.part("energy", r.energy, [](auto&& in, auto& s) { visit_energy(in, s); });
  if (v.has("stream"))
    v.part("stream", r.stream, [](auto&& in, auto& s) {
      visit_stream(in, s);
      in.numbers("swaps_s", s.swaps_s);
    });
  v.text("trace_hash", r.trace_hash);
  if (v.has("files"))
    v.group("files", true, [&r](auto&& in) {
      in.text("trace", r.trace_file);
      in.text("scores", r.scores_file);
    });
}

template <class V, class H>
void visit_head(V&& v, H& head) {
  v("version", head.version);
  v("commit", head.commit);
  v("build", head.build);
  v.group("machine", true, [&head](auto&& in) { visit_machine(in, head.machine); });
  v("started_utc", head.started_utc);
  v.later("command", head.command);
}

/// Keys behind has() are those that earlier documents lack.
template <class V, class D>
void visit_document(V&& v, D& d) {
  v("schema", d.schema);
  visit_head(v, d);
  if (v.has("title")) v.text("title", d.title);
  if (v.has("about")) v.text("about", d.about);
  v("scene", d.scene);
  v("path", d.path);
  if (v.has("path_hash")) v.text("path_hash", d.path_hash);
  if (v.has("conditions"))
    v.part("conditions", d.conditions, [](auto&& in, auto& c) {
      visit_conditions(in, c);
      in.pairs("libraries", c.libraries);
    });
  if (v.has("models"))
    v.parts("models", d.models, [](auto&& in, auto& model) {
      visit_model(in, model);
      in.text("sample", model.sample);
    });
  if (v.has("truth")) v.part("truth", d.truth, [](auto&& in, auto& s) { visit_truth(in, s); });
  if (v.has("scoring"))
    v.part("scoring", d.scoring, [](auto&& in, auto& s) {
      visit_scoring(in, s);
      in.numbers("felt_stiffness_n_per_mm", s.felt_stiffness_n_per_mm);
      in("forces_comparable", s.forces_comparable);
    });
  v.sentences("warnings", d.warnings);
  v.sentences("notes", d.notes);
  v.later("complete", d.complete);
  v.fixed("trace_hash_name", "fnv1a64");
  v.parts("renderers", d.renderers, [](auto&& in, auto& r) { visit_renderer(in, r); });
}

/// Invalid UTF-8 in file names becomes replacement characters instead of an exception.
std::string dump(const Json& json) {
  return json.dump(kIndent, ' ', false, Json::error_handler_t::replace);
}

}  // namespace

std::string head_json(const DocumentHead& head) {
  Json j = Json::object();
  visit_head(Writer{j}, head);
  return dump(j);
}

std::string to_json(const ResultDocument& document) {
  Json j = Json::object();
  visit_document(Writer{j}, document);
  return dump(j) + "\n";
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
  visit_document(top, document);
  if (!wrong.empty()) return Error{wrong, "give a result.json that palpate wrote", file};
  return document;
}

}  // namespace palpate::metrics
