#include "experiments/psychophysics/ledger.h"

#include <utility>

#include <palpate/result.h>

namespace palpate::experiments::psychophysics {

Ledger::Ledger(const Plan& plan, const std::string& observer, std::vector<Row>& rows, TrialFile file,
               long long stop_after)
    : plan_(plan),
      observer_(observer),
      rows_(rows),
      file_(std::move(file)),
      course_(plan),
      stop_after_(stop_after) {
  for (const Row& row : rows_) course_.answered(row);
}

Result<std::optional<Trial>> Ledger::next() const {
  std::optional<Trial> trial = course_.next();
  if (trial && trial->number > 2 * kMostTrials)
    return Error{"answers are excluded again and again, and the study does not end",
                 "look at the column 'excluded' of the trials", kTrialsFile, 0};
  return trial;
}

Status Ledger::enter(const Trial& trial, const Answer& answer) {
  Row row;
  row.trial = trial;
  row.answer = answer;
  row.excluded = exclusion_of(row.answer, plan_.exclusions);
  PALPATE_TRY(file_.write(csv_row(row, plan_, observer_)));
  course_.answered(row);
  rows_.push_back(std::move(row));
  ++asked_;
  return Done{};
}

}  // namespace palpate::experiments::psychophysics
