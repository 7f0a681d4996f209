#include "experiments/ablate/ablate.h"

#include <fmt/format.h>

#include <cmath>

#include <palpate/result.h>
#include "experiments/driver/json_document.h"

namespace palpate::experiments {

PALPATE_JSON_MEMBERS(AblateDocument, scene, path, renderer, truth, counted, warnings, notes, rows)

namespace {

constexpr const char* kWhole = "nothing: the whole scene";
/// Smaller changes are imperceptible (Weber's fraction of force, 7 %).
constexpr double kFeltPercent = 7.0;

/// Saving without the stage; negative for an increase.
template <class T>
std::optional<double> saved(const std::optional<T>& whole, const std::optional<T>& rest) {
  if (!whole || !rest) return std::nullopt;
  return static_cast<double>(*whole) - static_cast<double>(*rest);
}

/// Conclusions from a row and the whole scene's.
DocumentJson conclusions_of(const AblateRow& row, const AblateRow& whole) {
  return {{"stage", text_or_null(row.stage)},
          {"status", row.reason.empty() ? "ok" : "failed"},
          {"saves",
           {{"instructions", saved(whole.instructions, row.instructions)},
            {"frame_cpu_us", saved(whole.frame_cpu_us, row.frame_cpu_us)},
            {"bytes", saved(whole.bytes, row.bytes)},
            {"prepare_ms", saved(whole.prepare_ms, row.prepare_ms)}}}};
}

/// "512 (-104)": value without the stage and its difference to the whole scene.
template <class T>
Cell with_change(const std::optional<T>& value, const std::optional<T>& whole, bool is_whole) {
  if (!value) return {kMissingNumber};
  const double number = static_cast<double>(*value);
  if (is_whole || !whole) return {format_number(number)};
  const double change = number - static_cast<double>(*whole);
  if (change == 0.0) return {format_number(number) + " (0)"};
  return {fmt::format("{} ({}{})", format_number(number), change > 0.0 ? "+" : "-",
                      format_number(std::abs(change)))};
}

Cell percent_cell(const std::optional<double>& percent) {
  return {percent ? format_number(*percent) : std::string(kMissingNumber)};
}

/// The stage's cost in time and memory, and the loss without it.
Headline ablate_headline(const AblateRow& row, const AblateRow& whole) {
  if (!row.reason.empty()) return {row.stage, "cannot be left out: " + row.reason};
  std::string text;
  if (const std::optional<double> instructions = saved(whole.instructions, row.instructions))
    text += fmt::format("{} instructions a frame, ", format_number(*instructions));
  else if (const std::optional<double> us = saved(whole.frame_cpu_us, row.frame_cpu_us))
    text += fmt::format("{} µs a frame, ", format_number(*us));
  if (const std::optional<double> bytes = saved(whole.bytes, row.bytes))
    text += fmt::format("{} bytes; ", format_number(*bytes));
  if (!row.error_percent) return {row.stage, text + "nothing was in contact to tell what is lost"};
  text += fmt::format("without it the force changes by {} %", format_number(*row.error_percent));
  if (!(*row.error_percent > 0.0))
    text += ": along this path the scene does not require it";
  else if (*row.error_percent < kFeltPercent)
    text += fmt::format(", less than the {:g} % that a hand can tell", kFeltPercent);
  return {row.stage, text};
}

}  // namespace

std::string to_json(const AblateDocument& document) {
  DocumentJson json = begin_json(kAblateSchema, document.head);
  to_json(json, document);
  json["truth"] = text_or_null(document.truth);
  for (std::size_t i = 0; i < document.rows.size(); ++i)
    json["rows"][i].update(conclusions_of(document.rows[i], document.rows.front()));
  return document_text(json);
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
                          is_whole ? Cell{kMissingNumber} : percent_cell(row.error_percent),
                          percent_cell(row.truth_percent)});
  }
  table.notes = {
      "In brackets: the change against the whole scene. Frames are all of the path, in contact and free.",
      "\"Force changes by\" is the root mean square of the change, in percent of the whole scene's "
      "force; \"error\" is against the ground truth, where that knows all that the scene asks for.",
      document.counted};
  return table;
}

Page ablate_page(const AblateDocument& document) {
  Page page = begin_page("Stages that the scene requires", document.head);
  add_known(page, Known{{}, document.warnings, document.notes});
  HeadlineGroup group{"Cost of each stage, and loss without it", {}};
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

}  // namespace palpate::experiments
