#include "experiments/ablate/document.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "toolkit/core/try.h"

namespace palpate::experiments {
namespace {

using AblateJson = nlohmann::ordered_json;

constexpr const char* kWhole = "nothing: the whole scene";
/// A change of force below this share of it is below what a hand can tell (Weber's fraction of force, 7 %).
constexpr double kFeltPercent = 7.0;

template <class T>
AblateJson ablate_value(const std::optional<T>& value) {
  return value ? AblateJson(*value) : AblateJson(nullptr);
}

/// What leaving the stage out takes away; more than before is below 0.
template <class T>
std::optional<double> saved(const std::optional<T>& whole, const std::optional<T>& rest) {
  if (!whole || !rest) return std::nullopt;
  return static_cast<double>(*whole) - static_cast<double>(*rest);
}

AblateJson row_json(const AblateRow& row, const AblateRow& whole) {
  return {{"stage", row.stage.empty() ? AblateJson(nullptr) : AblateJson(row.stage)},
          {"instead", row.instead},
          {"status", row.reason.empty() ? "ok" : "failed"},
          {"reason", row.reason},
          {"instructions", ablate_value(row.instructions)},
          {"frame_cpu_us", ablate_value(row.frame_cpu_us)},
          {"bytes", ablate_value(row.bytes)},
          {"prepare_ms", ablate_value(row.prepare_ms)},
          {"error_percent", ablate_value(row.error_percent)},
          {"truth_percent", ablate_value(row.truth_percent)},
          {"saves",
           {{"instructions", ablate_value(saved(whole.instructions, row.instructions))},
            {"frame_cpu_us", ablate_value(saved(whole.frame_cpu_us, row.frame_cpu_us))},
            {"bytes", ablate_value(saved(whole.bytes, row.bytes))},
            {"prepare_ms", ablate_value(saved(whole.prepare_ms, row.prepare_ms))}}},
          {"trace_hash", row.trace_hash}};
}

/// "512 (-104)": with the stage left out, and the difference to the whole scene.
template <class T>
Cell with_change(const std::optional<T>& value, const std::optional<T>& whole, bool is_whole) {
  if (!value) return {kNoNumber};
  const double number = static_cast<double>(*value);
  if (is_whole || !whole) return {short_number(number)};
  const double change = number - static_cast<double>(*whole);
  if (change == 0.0) return {short_number(number) + " (0)"};
  return {fmt::format("{} ({}{})", short_number(number), change > 0.0 ? "+" : "-",
                      short_number(std::abs(change)))};
}

Cell percent_cell(const std::optional<double>& percent) {
  return {percent ? short_number(*percent) : std::string(kNoNumber)};
}

/// What the stage takes of frame and memory, and what is lost without it.
Headline ablate_headline(const AblateRow& row, const AblateRow& whole) {
  if (!row.reason.empty()) return {row.stage, "cannot be left out: " + row.reason};
  std::string text;
  if (const std::optional<double> instructions = saved(whole.instructions, row.instructions))
    text += fmt::format("{} instructions a frame, ", short_number(*instructions));
  else if (const std::optional<double> us = saved(whole.frame_cpu_us, row.frame_cpu_us))
    text += fmt::format("{} µs a frame, ", short_number(*us));
  if (const std::optional<double> bytes = saved(whole.bytes, row.bytes))
    text += fmt::format("{} bytes; ", short_number(*bytes));
  if (!row.error_percent) return {row.stage, text + "nothing was in contact to tell what is lost"};
  text += fmt::format("without it the force changes by {} %", short_number(*row.error_percent));
  if (!(*row.error_percent > 0.0))
    text += ": along this path the scene does not require it";
  else if (*row.error_percent < kFeltPercent)
    text += fmt::format(", less than the {:g} % that a hand can tell", kFeltPercent);
  return {row.stage, text};
}

Page ablate_page(const AblateDocument& document) {
  Page page = begin_page("What the scene requires", document.head);
  add_known(page, Known{{}, document.warnings, document.notes});
  HeadlineGroup group{"What each stage costs, and what is lost without it", {}};
  for (std::size_t i = 1; i < document.rows.size(); ++i)
    group.lines.push_back(ablate_headline(document.rows[i], document.rows.front()));
  if (group.lines.empty())
    group.lines.push_back({"Nothing can be left out", "the scene asks for points and a spring alone"});
  page.headlines.push_back(std::move(group));
  Section section;
  section.id = "stages";
  section.title = "Each stage left out in turn";
  section.tables.push_back(ablate_table(document));
  section.facts = {
      {"scene", {document.scene}},
      {"path", {document.path}},
      {"renderer", {document.renderer}},
      {"instructions", {document.counted}},
      {"ground truth",
       {document.truth.empty() ? "none that knows all that the scene asks for" : document.truth}}};
  page.sections.push_back(std::move(section));
  return page;
}

}  // namespace

std::string to_json(const AblateDocument& document) {
  AblateJson json = {{"schema", kAblateSchema}};
  json.update(AblateJson::parse(metrics::head_json(document.head)));
  json["scene"] = document.scene;
  json["path"] = document.path;
  json["renderer"] = document.renderer;
  json["truth"] = document.truth.empty() ? AblateJson(nullptr) : AblateJson(document.truth);
  json["counted"] = document.counted;
  json["warnings"] = document.warnings;
  json["notes"] = document.notes;
  json["rows"] = AblateJson::array();
  for (const AblateRow& row : document.rows) json["rows"].push_back(row_json(row, document.rows.front()));
  return json.dump(1, ' ', false, AblateJson::error_handler_t::replace) + "\n";
}

Table ablate_table(const AblateDocument& document) {
  Table table;
  table.title = fmt::format("{}: each stage left out in turn", document.renderer);
  table.columns = {"left out", "in its place",    "instructions a frame", "CPU µs a frame",
                   "bytes",    "ready after, ms", "force changes by, %",  "error, %"};
  const AblateRow& whole = document.rows.front();
  for (const AblateRow& row : document.rows) {
    const bool is_whole = row.stage.empty();
    table.rows.push_back({{is_whole ? kWhole : row.stage},
                          {row.reason.empty() ? row.instead : row.reason},
                          with_change(row.instructions, whole.instructions, is_whole),
                          with_change(row.frame_cpu_us, whole.frame_cpu_us, is_whole),
                          with_change(row.bytes, whole.bytes, is_whole),
                          with_change(row.prepare_ms, whole.prepare_ms, is_whole),
                          is_whole ? Cell{kNoNumber} : percent_cell(row.error_percent),
                          percent_cell(row.truth_percent)});
  }
  table.notes = {
      "In brackets: the change against the whole scene. Frames are all of the path, in contact and free.",
      "\"Force changes by\" is the root mean square of the change, in percent of the whole scene's "
      "force; \"error\" is against the ground truth, where that knows all that the scene asks for.",
      document.counted};
  return table;
}

Status write_ablate(const AblateDocument& document, const OutputFolder& folder) {
  PALPATE_TRY(write_page(ablate_page(document), folder));
  return folder.write(kAblateFile, to_json(document));
}

}  // namespace palpate::experiments
