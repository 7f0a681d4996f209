#include "experiments/trade/row.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <exception>
#include <limits>
#include <map>
#include <numeric>
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

namespace {

/// A row's number with its uncertainty.
struct Compared {
  Measured measured{};
  bool is_time = false;
  double slack = 0.0;
  bool is_known = true;
  bool is_error = false;
};

/// The numbers compared between rows, in a fixed order.
class Numbers {
 public:
  void push_back(const Compared& one) { all_[size_++] = one; }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] bool empty() const { return size_ == 0; }
  [[nodiscard]] const Compared& operator[](std::size_t i) const { return all_[i]; }
  [[nodiscard]] Compared& back() { return all_[size_ - 1]; }

 private:
  std::array<Compared, 5> all_{};
  std::size_t size_ = 0;
};

Numbers numbers_of(const Row& row) {
  Numbers all;
  all.push_back({*row.load_percent, true});
  all.push_back({*row.frame_p999_us, true});
  all.push_back({Measured{static_cast<double>(*row.bytes)}});
  all.push_back({*row.prepare_ms, true, row.preparations > 1 ? 0.0 : kOncePrepared, !row.from_cache});
  all.push_back({*row.error_p95_percent, false, 0.0, true, true});
  // Errors below the rounding floor count as equal.
  if (const double floor = row.error_floor_percent.value_or(0.0); all.back().measured.value <= floor)
    all.back().measured = Measured{0.0, Interval{0.0, std::max(floor, row.error_p95_percent->high())}};
  return all;
}

Numbers numbers_of(const Row& row, Cost cost) {
  Numbers all = numbers_of(row);
  const std::size_t at = cost == Cost::kSpeed ? 0 : cost == Cost::kMemory ? 2 : 3;
  Numbers two;
  two.push_back(all[at]);
  two.push_back(all.back());
  return two;
}

/// Change of the machine between two rows.
class Drift {
 public:
  explicit Drift(const std::vector<Row>& rows) {
    for (const Row& row : rows)
      if (row.anchor_us) {
        auto [at, is_new] = extremes_.try_emplace(row.machine.hash, *row.anchor_us, *row.anchor_us);
        at->second.first = std::min(at->second.first, *row.anchor_us);
        at->second.second = std::max(at->second.second, *row.anchor_us);
      }
  }
  [[nodiscard]] double between(const Row& a, const Row& b) const {
    if (a.anchor_us && b.anchor_us) return ratio(*a.anchor_us, *b.anchor_us);
    const auto at = extremes_.find(a.machine.hash);
    return at == extremes_.end() ? 0.0 : ratio(at->second.first, at->second.second);
  }

 private:
  static double ratio(double a, double b) {
    const double low = std::min(a, b);
    return low > 0.0 ? std::max(a, b) / low - 1.0 : 0.0;
  }
  std::map<std::string, std::pair<double, double>> extremes_;
};

/// log of a / b; 0 for equal numbers, zeros included.
double log_ratio(double a, double b) {
  if (a == b) return 0.0;
  constexpr double kLeast = std::numeric_limits<double>::min();
  return std::log(std::max(a, kLeast)) - std::log(std::max(b, kLeast));
}

bool dominates(const Numbers& a, const Numbers& b, double drift) {
  bool better = false;
  double on_the_whole = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (!a[i].is_known || !b[i].is_known) return false;  // unknown
    const double slack = std::max(a[i].slack, b[i].slack) + (a[i].is_time ? drift : 0.0);
    if (surely_less(b[i].measured, a[i].measured, slack)) return false;
    if (a[i].is_error && a[i].measured.value > (1.0 + kSameError) * b[i].measured.value) return false;
    better = better || surely_less(a[i].measured, b[i].measured, slack);
    on_the_whole += log_ratio(a[i].measured.value, b[i].measured.value);
  }
  return better && on_the_whole < 0.0;
}

/// For every row a row that dominates it, or itself.
std::vector<std::size_t> dominators(const std::vector<Row>& rows, const std::vector<Numbers>& numbers,
                                    const Drift& drift) {
  std::vector<std::size_t> by(rows.size());
  std::iota(by.begin(), by.end(), std::size_t{0});
  for (std::size_t b = 0; b < rows.size(); ++b)
    for (std::size_t a = 0; a < rows.size() && by[b] == b; ++a)
      if (a != b && !numbers[a].empty() && !numbers[b].empty() &&
          rows[a].machine.hash == rows[b].machine.hash &&
          dominates(numbers[a], numbers[b], drift.between(rows[a], rows[b])))
        by[b] = a;
  return by;
}

}  // namespace

const char* name_of(Cost cost) noexcept {
  return cost == Cost::kSpeed ? "speed" : cost == Cost::kMemory ? "memory" : "preparation";
}

std::optional<Measured> cost_of(const Row& row, Cost cost) {
  if (!row.ok()) return std::nullopt;
  if (cost == Cost::kSpeed) return row.load_percent;
  if (cost == Cost::kMemory) return Measured{row.bytes_per_point()};
  return row.from_cache ? std::nullopt : row.prepare_ms;
}

bool surely_less(const Measured& a, const Measured& b, double slack) noexcept {
  return a.high() * (1.0 + slack) < b.low();
}

std::vector<Standing> standings_of(const std::vector<Row>& rows) {
  const Drift drift(rows);
  std::vector<Standing> all(rows.size());
  std::vector<Numbers> numbers(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (rows[i].ok()) numbers[i] = numbers_of(rows[i]);
  const std::vector<std::size_t> by = dominators(rows, numbers, drift);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    all[i].dominated = by[i] != i;
    if (!all[i].dominated) continue;
    // The chain ends: each step is better on the whole.
    std::size_t best = by[i];
    while (by[best] != best) best = by[best];
    all[i].by = rows[best].setting;
  }
  for (const Cost cost : kCosts) {
    for (std::size_t i = 0; i < rows.size(); ++i)
      if (rows[i].ok()) numbers[i] = numbers_of(rows[i], cost);
    const std::vector<std::size_t> beaten = dominators(rows, numbers, drift);
    for (std::size_t i = 0; i < rows.size(); ++i)
      if (rows[i].ok() && beaten[i] == i && cost_of(rows[i], cost)) all[i].on_fronts.push_back(cost);
  }
  return all;
}

}  // namespace palpate::experiments
