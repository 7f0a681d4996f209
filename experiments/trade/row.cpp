#include "experiments/trade/row.h"

#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>
#include <span>

#include "toolkit/core/hash.h"
#include "toolkit/core/input_file.h"
#include "toolkit/core/try.h"
#include "toolkit/metrics/machine_info.h"

namespace palpate::experiments {
namespace {

using RowJson = nlohmann::ordered_json;

constexpr const char* kRowSchema = "palpate-row/1";
constexpr const char* kIntervalKey = "_interval";
constexpr const char* kRowRemedy =
    "take the line out of the file, or the whole file away to measure everything again";

void put(RowJson& json, const char* key, const std::optional<Measured>& measured) {
  json[key] = measured ? RowJson(measured->value) : RowJson(nullptr);
  if (measured && measured->interval)
    json[std::string(key) + kIntervalKey] = {measured->interval->low, measured->interval->high};
}

template <class T>
RowJson json_of(const std::optional<T>& value) {
  return value ? RowJson(*value) : RowJson(nullptr);
}

/// Reads keys and remembers the first one that is not what it should be.
class RowReader {
 public:
  explicit RowReader(const nlohmann::json& json) : json_(json) {}
  [[nodiscard]] const std::string& wrong() const { return wrong_; }

  void text(const char* key, std::string& value) {
    if (const auto* at = find(key, &nlohmann::json::is_string)) value = at->get<std::string>();
  }
  void flag(const char* key, bool& value) {
    if (const auto* at = find(key, &nlohmann::json::is_boolean)) value = at->get<bool>();
  }
  void number(const char* key, double& value) {
    if (const auto* at = find(key, &nlohmann::json::is_number)) value = at->get<double>();
  }
  template <class T>
  void whole(const char* key, T& value) {
    const auto* at = find(key, &nlohmann::json::is_number_integer);
    if (at == nullptr) return;
    if (at->is_number_unsigned() && at->get<std::uint64_t>() <= std::uint64_t{1} << 53)
      value = static_cast<T>(at->get<std::uint64_t>());
    else
      blame(key);
  }
  void maybe(const char* key, std::optional<double>& value) {
    if (is_null(key)) return;
    number(key, value.emplace());
  }
  void maybe(const char* key, std::optional<std::uint64_t>& value) {
    if (is_null(key)) return;
    whole(key, value.emplace());
  }
  void maybe(const char* key, std::optional<Measured>& value) {
    if (is_null(key)) return;
    number(key, value.emplace().value);
    const auto ends = json_.find(std::string(key) + kIntervalKey);
    if (ends == json_.end()) return;
    if (!ends->is_array() || ends->size() != 2 || !(*ends)[0].is_number() || !(*ends)[1].is_number())
      return blame(key);
    value->interval = Interval{(*ends)[0].get<double>(), (*ends)[1].get<double>()};
    if (!(value->interval->low <= value->interval->high)) blame(key);
  }
  const nlohmann::json* find(const char* key, bool (nlohmann::json::*is)() const noexcept) {
    const auto at = json_.find(key);
    if (at != json_.end() && ((*at).*is)()) return &*at;
    blame(key);
    return nullptr;
  }
  void blame(const char* key) {
    if (wrong_.empty()) wrong_ = key;
  }

 private:
  bool is_null(const char* key) {
    const auto at = json_.find(key);
    return at != json_.end() && at->is_null();
  }
  const nlohmann::json& json_;
  std::string wrong_;
};

void read_machine(RowReader& read, RowMachine& machine) {
  const nlohmann::json* json = read.find("machine", &nlohmann::json::is_object);
  if (json == nullptr) return;
  RowReader inner(*json);
  inner.text("name", machine.name);
  inner.text("cpu", machine.cpu);
  inner.text("hash", machine.hash);
  inner.whole("cores", machine.cores);
  if (!inner.wrong().empty() || machine.hash.empty()) read.blame("machine");
}

void read_lists(RowReader& read, Row& row) {
  if (const nlohmann::json* options = read.find("options", &nlohmann::json::is_object))
    for (const auto& [key, value] : options->items()) {
      if (!value.is_string()) return read.blame("options");
      row.options.emplace_back(key, value.get<std::string>());
    }
  if (const nlohmann::json* axes = read.find("axes", &nlohmann::json::is_array))
    for (const nlohmann::json& axis : *axes) {
      if (!axis.is_string()) return read.blame("axes");
      row.axes.push_back(axis.get<std::string>());
    }
}

Result<Row> row_of(const nlohmann::json& json) {
  Row row;
  RowReader read(json);
  std::string schema;
  read.text("schema", schema);
  if (schema != kRowSchema) read.blame("schema");
  read.text("setting", row.setting);
  read.text("experiment", row.experiment);
  read_machine(read, row.machine);
  read.text("renderer", row.renderer);
  read.text("works_on", row.works_on);
  read_lists(read, row);
  read.whole("precision_bits", row.precision_bits);
  read.whole("rate_divisor", row.rate_divisor);
  read.number("rate_hz", row.rate_hz);
  read.text("status", row.status);
  read.text("reason", row.reason);
  read.number("prepare_limit_s", row.prepare_limit_s);
  read.number("budget_s", row.budget_s);
  read.whole("points", row.points);
  read.whole("scene_points", row.scene_points);
  read.maybe("prepare_ms", row.prepare_ms);
  read.whole("preparations", row.preparations);
  read.flag("from_cache", row.from_cache);
  read.maybe("frame_all_mean_us", row.frame_mean_us);
  read.maybe("frame_all_p999_us", row.frame_p999_us);
  read.maybe("load_percent", row.load_percent);
  read.whole("passes", row.passes);
  read.maybe("anchor_us", row.anchor_us);
  read.maybe("bytes", row.bytes);
  read.maybe("error_p95_percent", row.error_p95_percent);
  read.maybe("error_rms_percent", row.error_rms_percent);
  read.maybe("error_floor_percent", row.error_floor_percent);
  read.maybe("indistinguishable_percent", row.indistinguishable_percent);
  read.text("trace_hash", row.trace_hash);
  read.number("steal_percent", row.steal_percent);
  read.number("load_before", row.load_before);
  read.text("measured_utc", row.measured_utc);
  if (row.setting.empty()) read.blame("setting");
  if (row.experiment.empty()) read.blame("experiment");
  if (row.status != "ok" && row.status != "failed" && row.status != "did-not-finish") read.blame("status");
  if (row.rate_divisor < 1) read.blame("rate_divisor");
  if (row.ok() && !(row.prepare_ms && row.frame_mean_us && row.frame_p999_us && row.load_percent &&
                    row.bytes && row.error_p95_percent))
    read.blame("status");
  if (!read.wrong().empty())
    return Error{fmt::format("this row has no right '{}'", read.wrong()), kRowRemedy, {}, 0};
  return row;
}

RowJson measured_json(const Row& row) {
  RowJson options = RowJson::object();
  for (const auto& [key, value] : row.options) options[key] = value;
  RowJson json = {{"setting", row.setting},
                  {"renderer", row.renderer},
                  {"works_on", row.works_on},
                  {"options", options},
                  {"axes", row.axes},
                  {"precision_bits", row.precision_bits},
                  {"rate_divisor", row.rate_divisor},
                  {"rate_hz", row.rate_hz},
                  {"status", row.status},
                  {"reason", row.reason},
                  {"prepare_limit_s", row.prepare_limit_s},
                  {"budget_s", row.budget_s},
                  {"points", row.points},
                  {"scene_points", row.scene_points}};
  put(json, "prepare_ms", row.prepare_ms);
  json["preparations"] = row.preparations;
  json["from_cache"] = row.from_cache;
  put(json, "frame_all_mean_us", row.frame_mean_us);
  put(json, "frame_all_p999_us", row.frame_p999_us);
  put(json, "load_percent", row.load_percent);
  json["passes"] = row.passes;
  json["anchor_us"] = json_of(row.anchor_us);
  json["bytes"] = json_of(row.bytes);
  json["bytes_per_point"] = row.bytes ? RowJson(row.bytes_per_point()) : RowJson(nullptr);
  put(json, "error_p95_percent", row.error_p95_percent);
  json["error_rms_percent"] = json_of(row.error_rms_percent);
  json["error_floor_percent"] = json_of(row.error_floor_percent);
  json["indistinguishable_percent"] = json_of(row.indistinguishable_percent);
  json["trace_hash"] = row.trace_hash;
  json["steal_percent"] = row.steal_percent;
  json["load_before"] = row.load_before;
  json["measured_utc"] = row.measured_utc;
  return json;
}

}  // namespace

RowMachine this_machine() {
  const metrics::MachineInfo info = metrics::machine_info();
  constexpr std::size_t kLongestName = 256;
  std::array<char, kLongestName> name{};
  if (::gethostname(name.data(), name.size() - 1) != 0) name = {};
  RowMachine machine{name.data(), info.cpu, {}, info.cores};
  Hash64 hash;
  for (const std::string& part : {machine.name, machine.cpu, info.kernel}) {
    hash.u64(part.size());
    hash.bytes(std::as_bytes(std::span(part)));
  }
  hash.u64(static_cast<std::uint64_t>(machine.cores));
  machine.hash = hash.hex();
  return machine;
}

std::string measured_text(const Row& row) {
  return measured_json(row).dump(-1, ' ', false, RowJson::error_handler_t::replace);
}

std::string row_text(const Row& row) {
  RowJson json = {{"schema", kRowSchema},
                  {"experiment", row.experiment},
                  {"machine",
                   {{"name", row.machine.name},
                    {"cpu", row.machine.cpu},
                    {"hash", row.machine.hash},
                    {"cores", row.machine.cores}}}};
  json.update(measured_json(row));
  return json.dump(-1, ' ', false, RowJson::error_handler_t::replace);
}

std::string rows_text(const std::vector<Row>& rows) {
  std::string text;
  for (const Row& row : rows) text += row_text(row) + "\n";
  return text;
}

Result<std::vector<Row>> rows_of(std::string_view text, const std::string& file) {
  std::vector<Row> rows;
  std::set<std::pair<std::string, std::string>> known;  // setting and machine
  for (std::int64_t line = 1; !text.empty(); ++line) {
    const std::size_t end = text.find('\n');
    if (end == std::string_view::npos) return Error{"the last line is cut short", kRowRemedy, file, line};
    const nlohmann::json json = nlohmann::json::parse(text.substr(0, end), nullptr, false);
    text.remove_prefix(end + 1);
    if (!json.is_object()) return Error{"this line is no JSON object", kRowRemedy, file, line};
    Result<Row> row = row_of(json);
    if (!row) return std::move(row).error().in_file(file, line);
    if (!known.insert({row->setting, row->machine.hash}).second)
      return Error{fmt::format("'{}' is there twice, of one machine", row->setting), kRowRemedy, file, line};
    if (row->experiment != (rows.empty() ? row->experiment : rows.front().experiment))
      return Error{"this row is of another scene, path or version than the first one", kRowRemedy, file,
                   line};
    rows.push_back(*std::move(row));
  }
  return rows;
}

Result<std::vector<Row>> read_rows(const std::string& file) {
  PALPATE_ASSIGN(const std::string text, read_file(file, kMostRowsBytes));
  return rows_of(text, file);
}

}  // namespace palpate::experiments
