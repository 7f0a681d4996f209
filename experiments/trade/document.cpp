#include "experiments/trade/document.h"

#include <fmt/format.h>

#include <algorithm>

#include <palpate/registry.h>
#include <palpate/result.h>
#include "experiments/driver/json_document.h"
#include "experiments/driver/suite.h"
#include "experiments/report/fronts.h"
#include "toolkit/core/files.h"

namespace palpate::experiments {

PALPATE_JSON_MEMBERS(SweepDocument, scene, path, truth, experiment, axes, full, warnings, notes, not_measured)

namespace {

constexpr std::size_t kMostShown = 24;  // lines of a terminal

struct MachineRows {
  RowMachine machine;
  std::vector<const Row*> rows;
  std::vector<const Standing*> standings;
};

std::vector<MachineRows> by_machine(const SweepDocument& document, const std::vector<Standing>& standings) {
  std::vector<MachineRows> all;
  for (std::size_t i = 0; i < document.rows.size(); ++i) {
    const Row& row = document.rows[i];
    auto at = std::find_if(all.begin(), all.end(),
                           [&](const MachineRows& m) { return m.machine.hash == row.machine.hash; });
    if (at == all.end()) at = all.insert(all.end(), {row.machine, {}, {}});
    at->rows.push_back(&row);
    at->standings.push_back(&standings[i]);
  }
  return all;
}

std::string machine_text(const RowMachine& machine) {
  return fmt::format("{} ({}, {} cores)", machine.name, machine.cpu, machine.cores);
}

std::string with_interval(const std::optional<Measured>& measured) {
  if (!measured) return kMissingNumber;
  const std::string value = format_number(measured->value);
  if (!measured->interval) return value;
  return fmt::format("{} ({} to {})", value, format_number(measured->interval->low),
                     format_number(measured->interval->high));
}

const char* cost_label(Cost cost) {
  switch (cost) {
    case Cost::kSpeed:
      return "load of one processor, % (mean frame times rate)";
    case Cost::kMemory:
      return "memory, bytes a point of the scene";
    case Cost::kPreparation:
      return "preparation, ms";
  }
  return "";
}

bool is_on(const Standing& standing, Cost cost) {
  return std::find(standing.on_fronts.begin(), standing.on_fronts.end(), cost) != standing.on_fronts.end();
}

std::vector<FrontPoint> points_of(const MachineRows& machine, Cost cost) {
  std::vector<FrontPoint> points;
  for (std::size_t i = 0; i < machine.rows.size(); ++i) {
    const Row& row = *machine.rows[i];
    const std::optional<Measured> paid = cost_of(row, cost);
    if (!paid) continue;
    const Measured& error = *row.error_p95_percent;
    points.push_back({row.setting, row.renderer, paid->value, paid->low(), paid->high(), error.value,
                      error.low(), error.high(), is_on(*machine.standings[i], cost)});
  }
  return points;
}

Table numbered_table(const std::vector<FrontPoint>& front, Cost cost) {
  Table table;
  table.title = fmt::format("The front of {} against accuracy", name_of(cost));
  table.columns = {"number", "setting", "error, %", cost_label(cost)};
  for (std::size_t i = 0; i < front.size(); ++i)
    table.rows.push_back(
        {{std::to_string(i + 1)},
         {front[i].setting},
         {with_interval(Measured{front[i].error, Interval{front[i].error_low, front[i].error_high}})},
         {with_interval(Measured{front[i].cost, Interval{front[i].cost_low, front[i].cost_high}})}});
  return table;
}

Table dominated_table(const MachineRows& machine) {
  Table table;
  table.title = "Dominated settings";
  table.caption =
      "Another setting is as good in load, longest frames, memory, preparation and error, and better in one.";
  table.columns = {"setting", "better"};
  for (std::size_t i = 0; i < machine.rows.size(); ++i)
    if (machine.standings[i]->dominated)
      table.rows.push_back({{machine.rows[i]->setting}, {machine.standings[i]->by}});
  return table;
}

Table failed_table(const MachineRows& machine) {
  Table table;
  table.title = "Settings that did not run to their end";
  table.columns = {"setting", "why"};
  for (const Row* row : machine.rows)
    if (!row->ok()) table.rows.push_back({{row->setting}, {row->reason}});
  return table;
}

Kind kind_of(const Row& row) {
  if (row.renderer == "sdf-godobject") return Kind::kField;
  if (row.works_on == render::name_of(render::Geometry::kMesh)) return Kind::kMesh;
  return row.works_on == render::name_of(render::Geometry::kHeights) ? Kind::kHeights : Kind::kPoints;
}

/// Mean frames at the path's own rate, by kind.
Chart kinds_of(const MachineRows& machine, const std::string& name) {
  std::vector<KindPoint> points;
  for (const Row* row : machine.rows) {
    if (!row->ok() || row->rate_divisor != 1) continue;
    const Measured &paid = *row->frame_mean_us, &error = *row->error_p95_percent;
    points.push_back({kind_of(*row),
                      {row->setting, row->renderer, paid.value, paid.low(), paid.high(), error.value,
                       error.low(), error.high(), false}});
  }
  return kinds_chart(name, "Cost of accuracy: points, meshes, distance grids", "mean of all frames, µs",
                     points);
}

Section section_of(const MachineRows& machine, std::size_t number, const OutputFolder& folder) {
  Section section;
  section.id = fmt::format("machine-{}", number);
  section.title = "Settings on " + machine_text(machine.machine);
  const auto measured = static_cast<std::size_t>(
      std::count_if(machine.rows.begin(), machine.rows.end(), [](const Row* row) { return row->ok(); }));
  section.paragraphs.push_back(fmt::format("{} settings were measured.", format_count(measured)));
  const Result<OutputFolder> figures = folder.inside("figures");
  if (figures)
    section.figures.push_back(draw(kinds_of(machine, fmt::format("kinds-{}", number)), *figures));
  else
    section.paragraphs.push_back(figures.error().message());
  for (const Cost cost : kCosts) {
    const std::vector<FrontPoint> points = points_of(machine, cost);
    if (figures)
      section.figures.push_back(
          draw(front_chart(fmt::format("front-{}-{}", name_of(cost), number),
                           fmt::format("Accuracy against {}", name_of(cost)), cost_label(cost), points),
               *figures));
    section.tables.push_back(numbered_table(numbered(points), cost));
  }
  for (Table table : {dominated_table(machine), failed_table(machine)})
    if (!table.rows.empty()) section.tables.push_back(std::move(table));
  return section;
}

std::vector<Headline> sweep_headlines(const MachineRows& machine) {
  std::vector<const Row*> best;
  for (std::size_t i = 0; i < machine.rows.size(); ++i)
    if (machine.rows[i]->ok() && !machine.standings[i]->dominated) best.push_back(machine.rows[i]);
  if (best.empty()) return {{"Nothing", "no setting ran to its end"}};
  const auto headline = [&](const char* lead, const auto& number) {
    const Row& row = **std::min_element(best.begin(), best.end(),
                                        [&](const Row* a, const Row* b) { return number(*a) < number(*b); });
    return Headline{
        lead, fmt::format("{}: error {} %, load {} %, {} bytes a point, ready after {}", row.setting,
                          format_number(row.error_p95_percent->value), format_number(row.load_percent->value),
                          format_number(row.bytes_per_point()), format_duration(row.prepare_ms->value))};
  };
  return {headline("Most accurate", [](const Row& row) { return row.error_p95_percent->value; }),
          headline("Least load", [](const Row& row) { return row.load_percent->value; }),
          headline("Least memory", [](const Row& row) { return row.bytes_per_point(); }),
          headline("Soonest ready", [](const Row& row) { return row.prepare_ms->value; })};
}

DocumentJson rows_json(const SweepDocument& document) {
  const std::vector<Standing> standings = standings_of(document.rows);
  DocumentJson rows = DocumentJson::array();
  for (std::size_t i = 0; i < document.rows.size(); ++i) {
    DocumentJson row = DocumentJson::parse(measured_text(document.rows[i]));
    row["machine"] = document.rows[i].machine.hash;
    row["dominated"] = standings[i].dominated;
    row["dominated_by"] = standings[i].dominated ? DocumentJson(standings[i].by) : DocumentJson(nullptr);
    row["fronts"] = DocumentJson::array();
    for (const Cost cost : standings[i].on_fronts) row["fronts"].push_back(name_of(cost));
    rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace

std::string to_json(const SweepDocument& document) {
  DocumentJson json = begin_json(kSweepSchema, document.head);
  to_json(json, document);
  json["budget_s"] = document.budget_s > 0.0 ? DocumentJson(document.budget_s) : DocumentJson(nullptr);
  json["machines"] = DocumentJson::array();
  for (const MachineRows& m : by_machine(document, std::vector<Standing>(document.rows.size())))
    json["machines"].push_back({{"hash", m.machine.hash},
                                {"name", m.machine.name},
                                {"cpu", m.machine.cpu},
                                {"cores", m.machine.cores}});
  json["rows"] = rows_json(document);
  return document_text(json);
}

Result<SweepDocument> read_sweep(const std::string& folder) {
  const std::string file = (std::filesystem::path(folder) / kSweepFile).string();
  PALPATE_ASSIGN(const std::string text, read_file(file, kMostRowsBytes));
  nlohmann::json json = nlohmann::json::parse(text, nullptr, false);
  const auto wrong = [&](const std::string& what) {
    return Error{what, "let `palpate compare sweep` write the folder again: it keeps what was measured",
                 file};
  };
  if (!json.is_object() || json.value("schema", nlohmann::json()) != kSweepSchema)
    return wrong(fmt::format("is no document of schema {}", kSweepSchema));
  json.emplace("full", false);  // where an earlier version left it out
  SweepDocument document;
  try {
    json.get_to(document);
    document.head = head_from(json);
  } catch (const nlohmann::json::exception& problem) {
    return wrong(fmt::format("cannot be read: {}", problem.what()));
  }
  PALPATE_ASSIGN(document.rows, read_rows((std::filesystem::path(folder) / kRowsFile).string()));
  if (!document.rows.empty() && document.rows.front().experiment != document.experiment)
    return wrong(fmt::format("is of another scene, path or version than {} beside it", kRowsFile));
  return document;
}

std::vector<Table> front_tables(const SweepDocument& document) {
  const std::vector<Standing> standings = standings_of(document.rows);
  std::vector<Table> tables;
  for (const MachineRows& machine : by_machine(document, standings)) {
    Table table;
    table.title = "Settings that nothing beats, on " + machine_text(machine.machine);
    table.columns = {"setting", "error, %", "load, %", "p99.9, µs", "bytes a point", "ready after, ms"};
    std::vector<const Row*> best;
    for (std::size_t i = 0; i < machine.rows.size(); ++i)
      if (machine.rows[i]->ok() && !machine.standings[i]->dominated) best.push_back(machine.rows[i]);
    std::sort(best.begin(), best.end(), [](const Row* a, const Row* b) {
      return a->error_p95_percent->value != b->error_p95_percent->value
                 ? a->error_p95_percent->value < b->error_p95_percent->value
                 : a->setting < b->setting;
    });
    for (const Row* row : best) {
      if (table.rows.size() == kMostShown) {
        table.notes.push_back(fmt::format("The report has {} more.", format_count(best.size() - kMostShown)));
        break;
      }
      table.rows.push_back({{row->setting},
                            {format_number(row->error_p95_percent->value)},
                            {format_number(row->load_percent->value)},
                            {format_number(row->frame_p999_us->value)},
                            {format_number(row->bytes_per_point())},
                            {format_number(row->prepare_ms->value)}});
    }
    table.notes.push_back(
        "Errors are the 95th percentile in percent of the true force; load is that of one processor.");
    tables.push_back(std::move(table));
  }
  return tables;
}

Page sweep_page(const SweepDocument& document, const OutputFolder& folder) {
  Page page = begin_page("Speed, memory and preparation against accuracy", document.head);
  const std::vector<Standing> standings = standings_of(document.rows);
  Known known{{}, document.warnings, document.notes};
  if (!document.not_measured.empty())
    known.notes.push_back(fmt::format("{} settings were not measured: there was no time.",
                                      format_count(document.not_measured.size())));
  add_known(page, std::move(known));
  std::size_t number = 0;
  for (const MachineRows& machine : by_machine(document, standings)) {
    Section section = section_of(machine, ++number, folder);
    section.facts.push_back({"scene", {document.scene}});
    section.facts.push_back({"path", {document.path}});
    section.facts.push_back({"ground truth", {document.truth}});
    page.headlines.push_back({section.title, sweep_headlines(machine)});
    page.sections.push_back(std::move(section));
  }
  return page;
}

}  // namespace palpate::experiments
