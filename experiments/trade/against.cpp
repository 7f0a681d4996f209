#include "experiments/trade/document.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <functional>
#include <optional>

#include <palpate/result.h>
#include "experiments/driver/json_document.h"
#include "experiments/study/study.h"
#include "experiments/trade/row.h"
#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

using metrics::RendererResult;
using metrics::ResultDocument;

// Lines that compare prints beside its table of six renderers and the report's place leave so many of
// fifteen.
constexpr std::size_t kMostLines = 2;

using MeasuredGet = std::function<std::optional<Measured>(const RendererResult&)>;

/// A number of a result, its better direction, and its accessor.
struct Looked {
  const char* key;
  bool is_time;
  bool more_is_better;
  double slack;
  MeasuredGet of;
};

template <class Part>
MeasuredGet number_in(std::optional<Part> RendererResult::*part, std::optional<double> Part::*value,
                      std::optional<Interval> Part::*interval) {
  return [=](const RendererResult& r) -> std::optional<Measured> {
    if (!(r.*part) || !(*(r.*part).*value)) return std::nullopt;
    return Measured{*(*(r.*part).*value), *(r.*part).*interval};
  };
}

MeasuredGet count_in(std::uint64_t metrics::Accuracy::*count) {
  return [=](const RendererResult& r) -> std::optional<Measured> {
    if (!r.accuracy) return std::nullopt;
    return Measured{static_cast<double>((*r.accuracy).*count)};
  };
}

std::optional<Measured> fresh_preparation(const RendererResult& r) {
  if (!r.prepare || prepared_from_cache(r)) return std::nullopt;
  return Measured{r.prepare->total_ms};
}

std::optional<Measured> memory_bytes(const RendererResult& r) {
  if (!r.prepare) return std::nullopt;
  return Measured{static_cast<double>(r.prepare->bytes)};
}

const std::vector<Looked>& looked_at() {
  using R = RendererResult;
  using F = trace::FrameStatistics;
  using A = metrics::Accuracy;
  static const std::vector<Looked> kAll = {
      {"frame_all.mean_us", true, false, 0.0, number_in(&R::frame_all, &F::mean_us, &F::mean_interval_us)},
      {"frame_all.p999_us", true, false, 0.0, number_in(&R::frame_all, &F::p999_us, &F::p999_interval_us)},
      {"frame.mean_us", true, false, 0.0, number_in(&R::frame, &F::mean_us, &F::mean_interval_us)},
      {"prepare.total_ms", true, false, kOncePrepared, fresh_preparation},
      {"memory.bytes", false, false, 0.0, memory_bytes},
      {"accuracy.force_rms_percent", false, false, 0.0,
       number_in(&R::accuracy, &A::force_rms_percent, &A::force_rms_percent_interval)},
      {"accuracy.indistinguishable_percent", false, true, 0.0,
       number_in(&R::accuracy, &A::indistinguishable_percent, &A::indistinguishable_interval)},
      {"accuracy.missed_contact_frames", false, false, 0.0, count_in(&A::missed_contact_frames)},
      {"accuracy.false_contact_frames", false, false, 0.0, count_in(&A::false_contact_frames)}};
  return kAll;
}

ChangeVerdict verdict_on(const Looked& looked, const Measured& before, const Measured& after) {
  if (surely_less(after, before, looked.slack))
    return looked.more_is_better ? ChangeVerdict::kWorse : ChangeVerdict::kBetter;
  if (surely_less(before, after, looked.slack))
    return looked.more_is_better ? ChangeVerdict::kBetter : ChangeVerdict::kWorse;
  return ChangeVerdict::kSame;
}

const char* verdict_text(ChangeVerdict verdict) {
  return verdict == ChangeVerdict::kBetter ? "better" : verdict == ChangeVerdict::kWorse ? "worse" : "same";
}

bool of_one_kind(const metrics::MachineInfo& a, const metrics::MachineInfo& b) {
  return a.cpu == b.cpu && a.cores == b.cores && a.kernel == b.kernel;
}

const RendererResult* labelled(const ResultDocument& document, const std::string& label) {
  for (const RendererResult& result : document.renderers)
    if (result.label == label) return &result;
  return nullptr;
}

Status check_same(const ResultDocument& before, const ResultDocument& after) {
  const auto hashes = [](const ResultDocument& document) {
    std::vector<std::string> all;
    for (const metrics::StudyModel& model : document.models) all.push_back(model.hash);
    return all;
  };
  const char* other = nullptr;
  // Names the root cause: another model has another path and truth.
  if ((before.truth ? before.truth->hash : "") != (after.truth ? after.truth->hash : ""))
    other = "another truth";
  if (before.path_hash != after.path_hash) other = "another path";
  if (hashes(before) != hashes(after)) other = "another model";
  if (other == nullptr) return Done{};
  return Error{fmt::format("is of {}: {} along {}", other, before.scene, before.path),
               fmt::format("compare with a run of {} along {}", after.scene, after.path)};
}

}  // namespace

bool Changes::worse_for_sure() const {
  return std::any_of(all.begin(), all.end(),
                     [](const Change& c) { return c.verdict == ChangeVerdict::kWorse && !c.is_time; });
}

Result<ResultDocument> read_earlier(const std::string& result) {
  std::error_code code;
  const std::filesystem::path path(result);
  const std::string file = (std::filesystem::is_directory(path, code) ? path / kResultFile : path).string();
  PALPATE_ASSIGN(const std::string text, read_file(file, kMemoryLimitBytes));
  return metrics::parse_result(text, file);
}

Result<Changes> changes_between(const ResultDocument& before, const ResultDocument& after) {
  PALPATE_TRY(check_same(before, after));
  Changes changes;
  const bool times = of_one_kind(before.machine, after.machine);
  if (!times)
    changes.notes.push_back(
        fmt::format("Times are not compared: the earlier run was on another machine ({}, {} cores, {}).",
                    before.machine.cpu, before.machine.cores, before.machine.kernel));
  for (const RendererResult& now : after.renderers) {
    const RendererResult* then = labelled(before, now.label);
    if (then == nullptr) {
      changes.notes.push_back(fmt::format("{} is not in the earlier run.", now.label));
      continue;
    }
    if (now.status != then->status)
      changes.all.push_back(
          {now.label, "status", then->status == metrics::RunStatus::kOk ? 1.0 : 0.0,
           now.status == metrics::RunStatus::kOk ? 1.0 : 0.0,
           now.status == metrics::RunStatus::kOk ? ChangeVerdict::kBetter : ChangeVerdict::kWorse});
    if (now.name != then->name || now.options != then->options)
      changes.notes.push_back(fmt::format("{} has other options than in the earlier run.", now.label));
    for (const Looked& looked : looked_at()) {
      if (looked.is_time && !times) continue;
      const std::optional<Measured> was = looked.of(*then), is = looked.of(now);
      if (was && is)
        changes.all.push_back(
            {now.label, looked.key, was->value, is->value, verdict_on(looked, *was, *is), looked.is_time});
    }
  }
  for (const RendererResult& then : before.renderers)
    if (labelled(after, then.label) == nullptr)
      changes.notes.push_back(fmt::format("{} ran earlier and not now.", then.label));
  return changes;
}

Table changes_table(const Changes& changes) {
  Table table;
  table.title = "Against the earlier run";
  table.columns = {"renderer", "number", "before", "now", "is"};
  table.best_means = "better, beyond the intervals of both";
  table.bad_means = "worse, beyond the intervals of both";
  for (const Change& c : changes.all)
    table.rows.push_back(
        {{c.label},
         {c.number},
         {format_number(c.before)},
         {format_number(c.after), c.verdict == ChangeVerdict::kBetter, c.verdict == ChangeVerdict::kWorse},
         {verdict_text(c.verdict)}});
  table.notes = changes.notes;
  return table;
}

std::string changes_text(const Changes& changes, std::size_t columns) {
  std::array<std::size_t, 3> counts{};
  std::vector<std::string> changed;
  for (const Change& c : changes.all) ++counts[static_cast<std::size_t>(c.verdict)];
  for (const bool time : {false, true})
    for (const ChangeVerdict verdict : {ChangeVerdict::kWorse, ChangeVerdict::kBetter})
      for (const Change& c : changes.all)
        if (c.verdict == verdict && c.is_time == time)
          changed.push_back(fmt::format("{} {} {}", c.label, c.number, verdict_text(verdict)));
  const auto count = [&](ChangeVerdict verdict) { return counts[static_cast<std::size_t>(verdict)]; };
  std::string text =
      fmt::format("Against the earlier run ({}): {} worse, {} better, {} the same", kAgainstFile,
                  count(ChangeVerdict::kWorse), count(ChangeVerdict::kBetter), count(ChangeVerdict::kSame));
  if (!changes.notes.empty()) text += fmt::format(", {} notes", changes.notes.size());
  const char* between = ": ";
  for (const std::string& one : changed) {
    std::vector<std::string> lines = wrapped(text + between + one + ", ..", columns);
    if (lines.size() > kMostLines) return text + (between[0] == ':' ? "" : ", ..");
    text += between + one;
    between = ", ";
  }
  return text;
}

std::string to_json(const Changes& changes, const ResultDocument& before, const ResultDocument& after) {
  DocumentJson json = {{"schema", kAgainstSchema},
                       {"before", {{"commit", before.commit}, {"started_utc", before.started_utc}}},
                       {"after", {{"commit", after.commit}, {"started_utc", after.started_utc}}},
                       {"changes", DocumentJson::array()},
                       {"notes", changes.notes}};
  for (const Change& c : changes.all)
    json["changes"].push_back({{"label", c.label},
                               {"number", c.number},
                               {"before", c.before},
                               {"after", c.after},
                               {"verdict", verdict_text(c.verdict)}});
  return document_text(json);
}

}  // namespace palpate::experiments
