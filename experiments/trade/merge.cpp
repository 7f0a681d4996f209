// Merges rows of several folders: sweeps of one scene, from one or more machines.
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>

#include <palpate/result.h>
#include "experiments/trade/sweep.h"

namespace palpate::experiments {
namespace {

std::string rows_file(const std::string& folder) {
  return (std::filesystem::path(folder) / kRowsFile).string();
}

/// Adds `other` to `whole`. Identical rows merge; two different rows of one setting and machine are an Error.
Status join(SweepDocument& whole, SweepDocument other, const std::string& folder) {
  if (other.experiment != whole.experiment)
    return Error{
        fmt::format("is of another scene ({}), path, truth or version of Palpate than the first ({})",
                    other.scene, whole.scene),
        "merge folders of one and the same sweep", rows_file(folder)};
  std::map<std::pair<std::string, std::string>, std::string> known;
  for (const Row& row : whole.rows) known[{row.setting, row.machine.hash}] = row_text(row);
  for (Row& row : other.rows) {
    const auto [at, is_new] = known.try_emplace({row.setting, row.machine.hash}, row_text(row));
    if (is_new)
      whole.rows.push_back(std::move(row));
    else if (at->second != row_text(row))
      return Error{fmt::format("'{}' was measured on {} in an earlier folder as well, with another result",
                               row.setting, row.machine.name),
                   "leave one of the folders out", rows_file(folder)};
  }
  for (const auto& [from, to] : {std::pair{&other.not_measured, &whole.not_measured},
                                 {&other.axes, &whole.axes},
                                 {&other.warnings, &whole.warnings},
                                 {&other.notes, &whole.notes}})
    for (std::string& text : *from)
      if (std::find(to->begin(), to->end(), text) == to->end()) to->push_back(std::move(text));
  whole.full = whole.full || other.full;
  return Done{};
}

Result<SweepDocument> merged(const MergeArguments& arguments) {
  PALPATE_ASSIGN(SweepDocument whole, read_sweep(arguments.folders.front()));
  for (std::size_t i = 1; i < arguments.folders.size(); ++i) {
    PALPATE_ASSIGN(SweepDocument other, read_sweep(arguments.folders[i]));
    PALPATE_TRY(join(whole, std::move(other), arguments.folders[i]));
  }
  std::set<std::string> measured;
  for (const Row& row : whole.rows) measured.insert(row.setting);
  std::erase_if(whole.not_measured, [&](const std::string& text) { return measured.contains(text); });
  whole.budget_s = 0.0;
  return whole;
}

Status check_apart(const MergeArguments& arguments) {
  std::error_code code;
  for (const std::string& folder : arguments.folders)
    if (std::filesystem::equivalent(folder, arguments.out, code))
      return Error{"is one of the folders that are merged", "give --out another name", arguments.out};
  return Done{};
}

}  // namespace

Result<int> run_merge(const MergeArguments& arguments, Context& context) {
  PALPATE_TRY(check_apart(arguments));
  PALPATE_ASSIGN(SweepDocument whole, merged(arguments));
  whole.head = new_head(context.command_line);
  Suite suite(context);
  PALPATE_TRY(suite.open(arguments.out));
  PALPATE_TRY(suite.begin(RunKey().add("merge")));
  suite.progress().report("drawing the fronts", -1.0);
  PALPATE_TRY(suite.folder().write(kRowsFile, rows_text(whole.rows)));
  PALPATE_TRY(publish_sweep(whole, suite, arguments.json));
  return kExitOk;
}

}  // namespace palpate::experiments
