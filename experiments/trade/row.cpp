#include "experiments/trade/row.h"

#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <concepts>
#include <exception>
#include <set>
#include <span>
#include <stdexcept>

#include <palpate/result.h>
#include "experiments/driver/json_document.h"
#include "toolkit/core/files.h"
#include "toolkit/core/hash.h"
#include "toolkit/metrics/machine_info.h"
#include "toolkit/metrics/result_keys.h"

namespace palpate::experiments {
namespace {

constexpr const char* kRowSchema = "palpate-row/1";
constexpr const char* kIntervalKey = "_interval";
constexpr const char* kRowRemedy =
    "take the line out of the file, or the whole file away to measure everything again";

/// Counts beyond it are not whole numbers in every reader of JSON.
constexpr std::uint64_t kMostCount = std::uint64_t{1} << 53;

using RowOptions = std::vector<std::pair<std::string, std::string>>;

/// Every key of a row's measurements with its member, in the order of the file.
template <class V, class RowOf>
void each_field(V& v, RowOf& s) {
  PALPATE_KEYS(setting, renderer, works_on, options, axes, precision_bits, rate_divisor, rate_hz, status,
               reason, prepare_limit_s, budget_s, points, scene_points, prepare_ms, preparations, from_cache)
  v("frame_all_mean_us", s.frame_mean_us);
  v("frame_all_p999_us", s.frame_p999_us);
  PALPATE_KEYS(load_percent, passes, anchor_us, bytes)
  v.derived("bytes_per_point", s);
  PALPATE_KEYS(error_p95_percent, error_rms_percent, error_floor_percent, indistinguishable_percent,
               trace_hash, steal_percent, load_before, measured_utc)
}

template <class V, class MachineOf>
void each_machine_field(V& v, MachineOf& s) {
  PALPATE_KEYS(name, cpu, hash, cores)
}

struct RowWriter {
  DocumentJson json = DocumentJson::object();

  template <class T>
  void operator()(const char* key, const T& value) {
    json[key] = value;
  }
  void operator()(const char* key, const RowOptions& options) {
    json[key] = DocumentJson::object();
    for (const auto& [name, value] : options) json[key][name] = value;
  }
  void operator()(const char* key, const std::optional<Measured>& measured) {
    json[key] = measured ? DocumentJson(measured->value) : DocumentJson(nullptr);
    if (measured && measured->interval)
      json[std::string(key) + kIntervalKey] = {measured->interval->low, measured->interval->high};
  }
  void derived(const char* key, const Row& row) {
    json[key] = row.bytes ? DocumentJson(row.bytes_per_point()) : DocumentJson(nullptr);
  }
};

/// Throws a std::exception at the first wrong value; `key` names it.
struct RowReader {
  const nlohmann::json& json;
  std::string key{};

  void require(const char* name, bool right) {
    key = name;
    if (!right) throw std::invalid_argument(name);
  }
  template <class T>
  void operator()(const char* name, T& value) {
    const nlohmann::json& at = json.at(key = name);
    if constexpr (std::integral<T> && !std::same_as<T, bool>)
      require(name, at.is_number_unsigned() && at.get<std::uint64_t>() <= kMostCount);
    at.get_to(value);
  }
  template <class T>
  void operator()(const char* name, std::optional<T>& value) {
    if (!json.at(key = name).is_null()) (*this)(name, value.emplace());
  }
  void operator()(const char* name, Measured& measured) {
    (*this)(name, measured.value);
    const auto ends = json.find(std::string(name) + kIntervalKey);
    if (ends == json.end()) return;
    measured.interval = Interval{ends->at(0).get<double>(), ends->at(1).get<double>()};
    require(name, measured.interval->low <= measured.interval->high);
  }
  void operator()(const char* name, RowOptions& options) {
    for (const auto& [option, value] : json.at(key = name).get_ref<const nlohmann::json::object_t&>())
      options.emplace_back(option, value.get<std::string>());
  }
  void derived(const char* /*name*/, const Row& /*row*/) {}
};

Result<Row> row_of(const nlohmann::json& json) {
  Row row;
  RowReader read{json};
  try {
    std::string schema;
    read("schema", schema);
    read.require("schema", schema == kRowSchema);
    read("experiment", row.experiment);
    RowReader machine{json.at(read.key = "machine")};
    each_machine_field(machine, row.machine);
    read.require("machine", !row.machine.hash.empty());
    each_field(read, row);
    read.require("setting", !row.setting.empty());
    read.require("experiment", !row.experiment.empty());
    read.require("rate_divisor", row.rate_divisor >= 1);
    const bool measured = row.prepare_ms && row.frame_mean_us && row.frame_p999_us && row.load_percent &&
                          row.bytes && row.error_p95_percent;
    read.require("status", row.ok() ? measured : row.status == "failed" || row.status == "did-not-finish");
  } catch (const std::exception&) {
    return Error{fmt::format("this row has no right '{}'", read.key), kRowRemedy};
  }
  return row;
}

DocumentJson measured_json(const Row& row) {
  RowWriter written;
  each_field(written, row);
  return std::move(written.json);
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
  return measured_json(row).dump(-1, ' ', false, DocumentJson::error_handler_t::replace);
}

std::string row_text(const Row& row) {
  RowWriter machine;
  each_machine_field(machine, row.machine);
  DocumentJson json = {{"schema", kRowSchema}, {"experiment", row.experiment}, {"machine", machine.json}};
  json.update(measured_json(row));
  return json.dump(-1, ' ', false, DocumentJson::error_handler_t::replace);
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
