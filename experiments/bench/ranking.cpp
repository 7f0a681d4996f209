#include "experiments/bench/ranking.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <utility>

#include "experiments/driver/json_document.h"
#include "experiments/driver/suite.h"
#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/statistics.h"

namespace palpate::experiments {

namespace {

constexpr std::array kMeasures = {
    BenchMeasure{"caught", "caught", "right", &BenchRow::caught, true},
    BenchMeasure{"lost", "lost", "right", &BenchRow::lost, true},
    BenchMeasure{"kicks", "kicks", "right", &BenchRow::kicks, true},
    BenchMeasure{"force_rms_percent", "force error, RMS %", "right", &BenchRow::force_rms_percent, false},
    BenchMeasure{"direction_mean_deg", "direction, mean °", "right", &BenchRow::direction_mean_deg, false},
    BenchMeasure{"force_peak_excess_percent", "largest force over the truth's, %", "right",
                 &BenchRow::force_peak_excess_percent, false},
    BenchMeasure{"frame_mean_us", "mean frame, µs", "fast", &BenchRow::frame_mean_us, false},
    BenchMeasure{"frame_p999_us", "p99.9 frame, µs", "fast", &BenchRow::frame_p999_us, false},
    BenchMeasure{"prepare_ms", "preparation, ms", "ready", &BenchRow::prepare_ms, false},
    BenchMeasure{"bytes_per_point", "bytes a point", "small", &BenchRow::bytes_per_point, false}};

constexpr std::uint64_t kMaxResultBytes = std::uint64_t{1} << 26;  // a thousand entries take some 10 MB

/// The shapes of a document, in order: what is resampled.
std::vector<std::string> shapes_of(const BenchDocument& document) {
  std::vector<std::string> shapes;
  for (const CaseInputs& one : document.cases)
    if (std::find(shapes.begin(), shapes.end(), one.shape) == shapes.end()) shapes.push_back(one.shape);
  return shapes;
}

struct Sample {
  std::size_t shape;
  double value;
};

/// Of shapes that are in the list; two documents have the same ones in any order.
std::vector<Sample> samples_of(const BenchDocument& document, const std::vector<std::string>& shapes,
                               const std::string& entry, const BenchMeasure& measure) {
  std::vector<Sample> samples;
  for (const BenchRow& row : document.rows) {
    const auto shape = std::find(shapes.begin(), shapes.end(), row.shape);
    if (const auto& value = row.*measure.value; row.entry == entry && value && shape != shapes.end())
      samples.push_back({static_cast<std::size_t>(shape - shapes.begin()), *value});
  }
  return samples;
}

/// Sum or median with shape i taken counts[i] times.
std::optional<double> together(const std::vector<Sample>& samples, std::span<const std::uint32_t> counts,
                               bool sum) {
  std::vector<double> values;
  for (const Sample& sample : samples) values.insert(values.end(), counts[sample.shape], sample.value);
  if (values.empty()) return std::nullopt;
  if (!sum) return upper_median(std::move(values));
  double all = 0.0;
  for (const double value : values) all += value;
  return all;
}

std::optional<double> together(const std::vector<Sample>& samples, std::size_t shapes, bool sum) {
  const std::vector<std::uint32_t> once(shapes, 1);
  return together(samples, once, sum);
}

std::string value_text(const BenchStanding& standing) {
  if (!standing.value) return kMissingNumber;
  std::string text = format_number(*standing.value);
  if (standing.interval)
    text += fmt::format(" ({} to {})", format_number(standing.interval->low),
                        format_number(standing.interval->high));
  if (standing.rank > 0) text += fmt::format(" #{}", standing.rank);
  return text;
}

Table group_table(const BenchDocument& document, std::string_view group,
                  const std::vector<std::vector<BenchStanding>>& standings) {
  Table table;
  table.title = std::string(group);
  table.title.front() = static_cast<char>(table.title.front() - 'a' + 'A');
  table.columns = {"entry", fmt::format("of {} cases", document.cases.size())};
  std::vector<std::size_t> columns;
  for (std::size_t m = 0; m < kMeasures.size(); ++m) {
    if (kMeasures[m].group != group) continue;
    columns.push_back(m);
    table.columns.emplace_back(kMeasures[m].title);
  }
  std::vector<std::size_t> order(document.entries.size());
  for (std::size_t e = 0; e < order.size(); ++e) order[e] = e;
  const std::size_t by =
      *std::find_if(columns.begin(), columns.end(), [](std::size_t m) { return !kMeasures[m].sum; });
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    const BenchStanding &x = standings[a][by], &y = standings[b][by];
    if ((x.rank > 0) != (y.rank > 0)) return x.rank > 0;
    return x.value && (!y.value || *x.value < *y.value);
  });
  for (const std::size_t e : order) {
    const std::size_t finished = finished_by(document, document.entries[e].label);
    std::vector<Cell> row = {plain(document.entries[e].label),
                             {std::to_string(finished), false, finished < document.cases.size()}};
    for (const std::size_t m : columns)
      row.push_back({value_text(standings[e][m]), standings[e][m].rank == 1, false});
    table.rows.push_back(std::move(row));
  }
  table.best_means = "no other is surely better";
  table.bad_means = "not all cases: no rank";
  return table;
}

Table case_table(const BenchDocument& document) {
  Table table;
  table.title = "Every case: force error, RMS %; caught, lost, kicks";
  table.columns = {"case"};
  for (const BenchEntry& entry : document.entries) table.columns.push_back(entry.label);
  for (const CaseInputs& one : document.cases) {
    std::vector<Cell> cells = {plain(one.name)};
    for (const BenchEntry& entry : document.entries) {
      Cell cell = plain(kMissingNumber);
      for (const BenchRow& row : document.rows)
        if (row.entry == entry.label && row.name == one.name && row.force_rms_percent)
          cell.text = fmt::format("{:.1f}; {}, {}, {}", *row.force_rms_percent, row.caught.value_or(0.0),
                                  row.lost.value_or(0.0), row.kicks.value_or(0.0));
      cells.push_back(std::move(cell));
    }
    table.rows.push_back(std::move(cells));
  }
  return table;
}

/// A row for each entry and case, and no other: more would count twice. Empty: so it is.
std::string fault_of_rows(const BenchDocument& document) {
  std::map<std::string, std::string> shape_of;
  for (const CaseInputs& one : document.cases)
    if (!shape_of.emplace(one.name, one.shape).second)
      return fmt::format("has the case '{}' twice", one.name);
  std::set<std::string> entries;
  for (const BenchEntry& entry : document.entries)
    if (!entries.insert(entry.label).second) return fmt::format("has the entry '{}' twice", entry.label);
  std::set<std::pair<std::string, std::string>> rows;
  for (const BenchRow& row : document.rows) {
    const auto shape = shape_of.find(row.name);
    if (shape == shape_of.end() || shape->second != row.shape || !entries.contains(row.entry))
      return fmt::format("has a row of no case and entry: '{}', '{}'", row.name, row.entry);
    if (!rows.emplace(row.entry, row.name).second)
      return fmt::format("has two rows of '{}' on '{}'", row.entry, row.name);
  }
  if (rows.size() != entries.size() * shape_of.size())
    return fmt::format("has {} rows, not one for each of {} entries and {} cases", rows.size(),
                       entries.size(), shape_of.size());
  return {};
}

DocumentJson standings_json(const BenchDocument& document) {
  DocumentJson all = DocumentJson::object();
  const auto standings = standings_of(document);
  for (std::size_t e = 0; e < document.entries.size(); ++e) {
    DocumentJson& one = all[document.entries[e].label];
    one["finished"] = finished_by(document, document.entries[e].label);
    for (std::size_t m = 0; m < kMeasures.size(); ++m) {
      const BenchStanding& s = standings[e][m];
      DocumentJson interval = nullptr;
      if (s.interval) interval = {s.interval->low, s.interval->high};
      one[std::string(kMeasures[m].key)] = {{"value", s.value}, {"interval", interval}, {"rank", s.rank}};
    }
  }
  return all;
}

}  // namespace

std::span<const BenchMeasure> bench_measures() {
  return kMeasures;
}

std::size_t finished_by(const BenchDocument& document, const std::string& entry) {
  return static_cast<std::size_t>(
      std::count_if(document.rows.begin(), document.rows.end(),
                    [&](const BenchRow& row) { return row.entry == entry && row.reason.empty(); }));
}

std::vector<std::vector<BenchStanding>> standings_of(const BenchDocument& document) {
  const std::vector<std::string> shapes = shapes_of(document);
  std::vector<std::vector<BenchStanding>> standings;
  // Numbers by entry and measure, of entries that finished every case, and the most that one of them has. An
  // error of the direction is none where nothing was felt: who feels only the easy cases must not lead by it.
  std::vector<std::vector<std::size_t>> numbers;
  std::array<std::size_t, kMeasures.size()> most{};
  for (const BenchEntry& entry : document.entries) {
    std::vector<BenchStanding>& own = standings.emplace_back();
    std::vector<std::size_t>& of = numbers.emplace_back(kMeasures.size(), 0);
    const bool finished = finished_by(document, entry.label) == document.cases.size();
    for (std::size_t m = 0; m < kMeasures.size(); ++m) {
      const bool sum = kMeasures[m].sum;
      const std::vector<Sample> samples = samples_of(document, shapes, entry.label, kMeasures[m]);
      own.push_back({together(samples, shapes.size(), sum),
                     bootstrap(shapes.size(), [&](std::span<const std::uint32_t> counts,
                                                  Random&) { return together(samples, counts, sum); }),
                     0});
      of[m] = finished ? samples.size() : 0;
      most[m] = std::max(most[m], of[m]);
    }
  }
  const auto competes_in = [&](std::size_t e, std::size_t m) {
    return standings[e][m].interval && numbers[e][m] > 0 && numbers[e][m] == most[m];
  };
  for (std::size_t m = 0; m < kMeasures.size(); ++m)
    for (std::size_t e = 0; e < standings.size(); ++e) {
      if (!competes_in(e, m)) continue;
      standings[e][m].rank = 1;
      for (std::size_t other = 0; other < standings.size(); ++other)
        if (competes_in(other, m) && standings[other][m].interval->high < standings[e][m].interval->low)
          ++standings[e][m].rank;
    }
  return standings;
}

std::vector<Table> bench_tables(const BenchDocument& document) {
  const auto standings = standings_of(document);
  std::vector<Table> tables;
  for (const char* group : {"right", "fast", "ready", "small"})
    tables.push_back(group_table(document, group, standings));
  tables.push_back(case_table(document));
  return tables;
}

Table tuning_table(const BenchDocument& document, const BenchDocument& other) {
  const std::vector<std::string> shapes = shapes_of(document);
  Table table;
  table.title = "Tuning";
  table.caption = fmt::format("The {} cases less the {} ones; an interval above 0 is worse on the {} ones.",
                              document.seed, other.seed, document.seed);
  table.columns = {"entry"};
  for (const BenchMeasure& measure : kMeasures)
    if (measure.group == "right") table.columns.emplace_back(measure.title);
  for (const BenchEntry& entry : document.entries) {
    std::vector<Cell> row = {plain(entry.label)};
    for (const BenchMeasure& measure : kMeasures) {
      if (measure.group != "right") continue;
      const std::vector<Sample> here = samples_of(document, shapes, entry.label, measure),
                                there = samples_of(other, shapes, entry.label, measure);
      const auto less = [&](std::span<const std::uint32_t> counts) -> std::optional<double> {
        const auto a = together(here, counts, measure.sum), b = together(there, counts, measure.sum);
        return a && b ? std::optional(*a - *b) : std::nullopt;
      };
      const std::vector<std::uint32_t> once(shapes.size(), 1);
      const BenchStanding difference{less(once),
                                     bootstrap(shapes.size(), [&](std::span<const std::uint32_t> counts,
                                                                  Random&) { return less(counts); }),
                                     0};
      row.push_back({value_text(difference), false, difference.interval && difference.interval->low > 0.0});
    }
    table.rows.push_back(std::move(row));
  }
  table.bad_means = "surely worse";
  return table;
}

std::string to_json(const BenchDocument& document) {
  DocumentJson json = begin_json(kBenchSchema, document.head);
  json["bench_version"] = kBenchVersion;
  json["quick"] = document.quick;
  json["threads"] = document.threads;
  json["seed"] = {{"name", document.seed}, {"sha256", document.seed_sha256}};
  json["cases"] = nlohmann::json(document.cases);
  json["entries"] = nlohmann::json(document.entries);
  json["standings"] = standings_json(document);
  json["rows"] = nlohmann::json(document.rows);
  return document_text(json);
}

Result<BenchDocument> read_bench(const std::string& file) {
  PALPATE_ASSIGN(const std::string text, read_file(file, kMaxResultBytes));
  const nlohmann::json json = nlohmann::json::parse(text, nullptr, false);
  const auto not_ours = [&](const std::string& what) {
    return Error{what, fmt::format("give the {} that `palpate test bench` has written", kBenchFile), file};
  };
  if (!json.is_object() || json.value("schema", nlohmann::json()) != kBenchSchema)
    return not_ours(fmt::format("is no document of schema {}", kBenchSchema));
  if (json.value("bench_version", nlohmann::json()) != kBenchVersion)
    return not_ours(fmt::format("is not of version {} of the bench", kBenchVersion));
  BenchDocument document;
  try {
    document.head = head_from(json);
    document.quick = json.at("quick").get<bool>();
    document.threads = json.at("threads").get<int>();
    document.seed = json.at("seed").at("name").get<std::string>();
    document.seed_sha256 = json.at("seed").at("sha256").get<std::string>();
    document.cases = json.at("cases").get<std::vector<CaseInputs>>();
    document.entries = json.at("entries").get<std::vector<BenchEntry>>();
    document.rows = json.at("rows").get<std::vector<BenchRow>>();
  } catch (const nlohmann::json::exception& problem) {
    return not_ours(fmt::format("cannot be read: {}", problem.what()));
  }
  if (const std::string fault = fault_of_rows(document); !fault.empty()) return not_ours(fault);
  if (json.value("standings", nlohmann::json()) != nlohmann::json::parse(standings_json(document).dump()))
    return not_ours("has standings that do not follow from its rows");
  return document;
}

}  // namespace palpate::experiments
