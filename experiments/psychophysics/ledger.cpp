#include "experiments/psychophysics/ledger.h"

#include <filesystem>
#include <utility>

#include <palpate/result.h>
#include "experiments/driver/json_members.h"
#include "toolkit/core/files.h"

namespace palpate::experiments::psychophysics {
namespace {

// Largest file accepted; a session has some 600 bytes.
constexpr std::uint64_t kMostSessionBytes = std::uint64_t{1} << 24;
constexpr const char* kSessionRemedy = "take the line out; the trials do not need it";

}  // namespace

PALPATE_JSON_MEMBERS(SessionRecord, started_utc, first_trial, last_trial, real_time, scheduling, rate_hz,
                     ticks, missed, trial_frames, whole_frames, watchdog_trips, begun_again, notes)

namespace {

SessionRecord session_of(const DocumentJson& json) {
  SessionRecord s = json.get<SessionRecord>();
  const DocumentJson& late = json.at("late_us");
  late.at("p50").get_to(s.late_p50_us);
  late.at("p99").get_to(s.late_p99_us);
  late.at("p999").get_to(s.late_p999_us);
  late.at("max").get_to(s.late_most_us);
  return s;
}

/// Parses the file's text. Errors name the invalid line.
Result<std::vector<SessionRecord>> sessions_of(std::string_view text, const std::string& file) {
  std::vector<SessionRecord> sessions;
  for (std::int64_t line = 1; !text.empty(); ++line) {
    const std::size_t end = text.find('\n');
    if (end == std::string_view::npos) return Error{"the last line is cut short", kSessionRemedy, file, line};
    const DocumentJson json = DocumentJson::parse(text.substr(0, end), nullptr, false);
    text.remove_prefix(end + 1);
    try {
      sessions.push_back(session_of(json));
    } catch (const nlohmann::json::exception& wrong) {
      return Error{std::string("this line is no session: ") + wrong.what(), kSessionRemedy, file, line};
    }
  }
  return sessions;
}

}  // namespace

std::string session_line(const SessionRecord& s) {
  DocumentJson json = s;
  json["late_us"] = {
      {"p50", s.late_p50_us}, {"p99", s.late_p99_us}, {"p999", s.late_p999_us}, {"max", s.late_most_us}};
  return json.dump(-1, ' ', false, DocumentJson::error_handler_t::replace);
}

Result<std::vector<SessionRecord>> read_sessions(const OutputFolder& folder) {
  const std::string file = folder.file(kSessionsFile).string();
  std::error_code code;
  if (!std::filesystem::exists(file, code)) return std::vector<SessionRecord>{};
  PALPATE_ASSIGN(const std::string text, read_file(file, kMostSessionBytes));
  return sessions_of(text, file);
}

Status write_sessions(const OutputFolder& folder, const std::vector<SessionRecord>& sessions) {
  std::string text;
  for (const SessionRecord& one : sessions) text += session_line(one) + "\n";
  return folder.write(kSessionsFile, text);
}

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
                 "look at the column 'excluded' of the trials", kTrialsFile};
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
