#include "experiments/psychophysics/trials.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <utility>

#include <palpate/options.h>
#include <palpate/result.h>
#include "experiments/driver/json_document.h"
#include "toolkit/core/files.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments::psychophysics {
namespace {

// Purposes of seeds derived from a participant's seed.
enum Purpose : std::uint64_t { kOrder = 1, kAnswers, kCells, kCatchPlaces, kCatchCells, kPracticeCells };
constexpr std::uint64_t kMostTrialBytes = std::uint64_t{1} << 26;  // a row has some 150 bytes

std::uint64_t participant_seed(const Plan& plan, std::uint64_t purpose) noexcept {
  std::uint64_t mixed = plan.seed;
  for (const char c : plan.participant) mixed = seed_for(mixed, static_cast<unsigned char>(c));
  return seed_for(mixed, purpose);
}

/// Sets a cell's stimuli and right answer.
void set_cell(Task task, std::size_t cell, Trial& trial) {
  const bool second = cell % 2 == 1, turned = cell / 2 == 1;
  const char first = turned ? 'B' : 'A', other = turned ? 'A' : 'B';
  trial.right = second ? 1 : 0;
  switch (task) {
    case Task::kAbx:
      trial.shown = {first, other, second ? other : first};
      break;
    case Task::kSameDifferent:
      trial.shown = {first, second ? other : first};
      break;
    case Task::kTwoInterval:
      trial.shown = second ? "AB" : "BA";
      break;
    case Task::kYesNo:
      trial.shown = second ? "B" : "A";
      break;
  }
}

Result<std::string> taken(const std::vector<std::string>& cells, std::size_t at, const std::string& wanted) {
  if (cells[at] == wanted) return wanted;
  return Error{
      fmt::format("{} is {} and not {}", trial_columns()[at].name, shown(cells[at]), shown(wanted)),
      "the file is of another plan, participant or observer, or was changed: give --out a new folder"};
}

/// Parses a row, which must match the course's next trial. Cells are csv_row()'s.
Result<Row> parse_row(const std::string& line, const Trial& expected, const Plan& plan,
                      const std::string& observer) {
  const std::vector<std::string> cells = split_list(line);
  if (cells.size() != trial_columns().size())
    return Error{fmt::format("has {} columns and not {}", cells.size(), trial_columns().size()),
                 "the file was changed: give --out a new folder"};
  Row row;
  row.trial = expected;
  constexpr NumberRange kCount{0, 1e12}, kSeconds{0.0, 1e12}, kChoice{0, 1}, kConfidence{0, 4};
  const std::vector<std::string> same = split_list(csv_row(row, plan, observer));
  std::size_t at = 0;
  constexpr std::size_t kToRight = 8;
  for (; at < kToRight; ++at) PALPATE_TRY(taken(cells, at, same[at]));
  PALPATE_ASSIGN(const long long choice, read_integer(cells[at++], kChoice));
  row.answer.choice = static_cast<int>(choice);
  PALPATE_TRY(taken(cells, at++, row.correct() ? "1" : "0"));
  PALPATE_ASSIGN(const long long confidence, read_integer(cells[at++], kConfidence));
  row.answer.confidence = static_cast<int>(confidence);
  PALPATE_ASSIGN(row.answer.seconds, read_number(cells[at++], kSeconds));
  constexpr std::size_t kSwitchCells = 3;
  for (const std::size_t last = at + kSwitchCells; at < last; ++at) PALPATE_TRY(taken(cells, at, same[at]));
  PALPATE_ASSIGN(const long long missed, read_integer(cells[at++], kCount));
  PALPATE_ASSIGN(const long long clipped, read_integer(cells[at++], kCount));
  row.answer.missed_deadlines = static_cast<std::uint64_t>(missed);
  row.answer.clipped_frames = static_cast<std::uint64_t>(clipped);
  row.excluded = exclusion_of(row.answer, plan.exclusions);
  PALPATE_TRY(taken(cells, at++, row.excluded));
  PALPATE_TRY(taken(cells, at, same[at]));
  return row;
}

}  // namespace

const char* name_of(TrialKind kind) noexcept {
  return kind == TrialKind::kPractice ? "practice" : kind == TrialKind::kMain ? "main" : "catch";
}

std::size_t Trial::sham_switches() const noexcept {
  std::size_t shams = 0;
  for (std::size_t i = 1; i < shown.size(); ++i) shams += shown[i] == shown[i - 1] ? 1u : 0u;
  return shams;
}

std::string exclusion_of(const Answer& answer, const Exclusions& rule) {
  if (answer.missed_deadlines > rule.missed_deadlines) return "missed deadline";
  if (answer.clipped_frames > rule.clipped_frames) return "clipped force";
  if (answer.seconds < rule.fastest_s) return "too fast";
  if (answer.seconds > rule.slowest_s) return "too slow";
  return {};
}

double easiest_level(const Plan& plan) noexcept {
  if (plan.compares()) return 0.0;
  if (plan.catch_level > 0.0) return plan.catch_level;
  switch (plan.procedure) {
    case ProcedureKind::kFixed:
      return plan.levels.back();
    case ProcedureKind::kUpDown:
      return plan.up_down.start;
    case ProcedureKind::kPsi:
      return plan.psi.high;
  }
  return 0.0;
}

std::uint64_t order_seed(const Plan& plan) noexcept {
  return participant_seed(plan, kOrder);
}

std::uint64_t answer_seed(const Plan& plan) noexcept {
  return participant_seed(plan, kAnswers);
}

std::unique_ptr<Adaptive> Course::new_procedure(const Plan& plan) {
  if (plan.procedure == ProcedureKind::kUpDown) return std::make_unique<UpDown>(plan.up_down);
  if (plan.procedure == ProcedureKind::kPsi) return std::make_unique<Psi>(plan.psi);
  return nullptr;
}

std::uint64_t Course::fixed_trials(const Plan& plan) noexcept {
  return plan.compares() ? plan.count : plan.count * plan.levels.size();
}

Course::Course(const Plan& plan) : plan_(plan), seed_(order_seed(plan)), procedure_(new_procedure(plan)) {}

std::optional<Trial> Course::next() const {
  Trial trial;
  trial.number = done_ + 1;
  trial.level = easiest_level(plan_);
  const std::size_t cells = plan_.cells();
  if (practised_ < plan_.practice) {
    trial.kind = TrialKind::kPractice;
    set_cell(plan_.task, balanced_cell(seed_for(seed_, kPracticeCells), practised_, cells), trial);
    return trial;
  }
  const std::optional<double> level = procedure_ ? procedure_->level() : std::nullopt;
  if (procedure_ ? !level : main_ >= fixed_trials(plan_)) return std::nullopt;
  const std::uint64_t since = done_ - practised_;
  trial.break_before = plan_.break_every > 0 && since > 0 && since % plan_.break_every == 0;
  // Each block has one catch trial at an unpredictable place.
  if (plan_.catch_every > 0 && catches_ <= main_ / plan_.catch_every) {
    Random random(seed_for(seed_for(seed_, kCatchPlaces), catches_));
    if (main_ >= catches_ * plan_.catch_every + random.below(plan_.catch_every)) {
      trial.kind = TrialKind::kCatch;
      set_cell(plan_.task, balanced_cell(seed_for(seed_, kCatchCells), catches_, cells), trial);
      return trial;
    }
  }
  const std::uint64_t seed = seed_for(seed_, kCells);
  if (procedure_ || plan_.compares()) {
    if (procedure_) trial.level = *level;
    set_cell(plan_.task, balanced_cell(seed, main_, cells), trial);
  } else {
    const std::size_t both = balanced_cell(seed, main_, cells * plan_.levels.size());
    trial.level = plan_.levels[both / cells];
    set_cell(plan_.task, both % cells, trial);
  }
  return trial;
}

void Course::answered(const Row& row) {
  ++done_;
  switch (row.trial.kind) {
    case TrialKind::kPractice:
      ++practised_;
      return;
    case TrialKind::kCatch:
      ++catches_;
      return;
    case TrialKind::kMain:
      ++main_;
      if (procedure_ && row.excluded.empty()) procedure_->answered(row.correct());
  }
}

const std::vector<Column>& trial_columns() {
  static const std::vector<Column> kColumns = {
      {"participant", "", "code"},
      {"observer", "", "who answered"},
      {"seed", "", "of the plan"},
      {"trial", "", "number, from 1, of all kinds"},
      {"kind", "", "practice, main or catch; main trials alone are counted"},
      {"level", "unit of the option", "difference from the standard; empty where renderers are compared"},
      {"shown", "", "a letter an interval, in order; study.json says what A and B are"},
      {"right_answer", "", "0: the first, same, the standard; 1: the second, different, the other"},
      {"answer", "", "as right_answer"},
      {"correct", "", "1: right"},
      {"confidence", "", "1 guessed .. 4 sure; 0: not asked for"},
      {"answer_s", "s", "from the end of the last interval to the answer"},
      {"switches", "", "between intervals"},
      {"sham_switches", "", "of these, between two that are the same, with the same delay"},
      {"switch_delay_s", "s", "of every switch"},
      {"missed_deadlines", "", "of the servo in this trial"},
      {"clipped_frames", "", "forces that the governor limited"},
      {"excluded", "", "why the trial does not count, by the rule of the plan; empty: it counts"},
      {"break_before", "", "1: a break was offered before this trial"}};
  return kColumns;
}

std::string csv_head() {
  return joined(names_of(trial_columns()), ",") + "\n";
}

std::string csv_row(const Row& row, const Plan& plan, const std::string& observer) {
  const Trial& t = row.trial;
  const Answer& a = row.answer;
  return fmt::format(
      "{},{},{},{},{},{},{},{},{},{},{},{:.3f},{},{},{:.3f},{},{},{},{}", plan.participant, observer,
      plan.seed, t.number, name_of(t.kind), plan.compares() ? "" : fmt::format("{:.9g}", t.level), t.shown,
      t.right, a.choice, row.correct() ? 1 : 0, a.confidence, a.seconds, t.switches(), t.sham_switches(),
      plan.switch_delay_s, a.missed_deadlines, a.clipped_frames, row.excluded, t.break_before ? 1 : 0);
}

Result<ReadTrials> read_trials(const std::string& file, const Plan& plan, const std::string& observer) {
  PALPATE_ASSIGN(const std::string text, read_file(file, kMostTrialBytes));
  const std::string head = csv_head();
  if (!text.starts_with(head))
    return Error{"the columns are not those of this version", "give --out a new folder", file, 1};
  ReadTrials read;
  read.whole_bytes = head.size();
  Course course(plan);
  std::int64_t line = 1;
  for (std::size_t at = head.size(); at < text.size();) {
    const std::size_t end = text.find('\n', at);
    if (end == std::string::npos) break;  // cut off while being written
    ++line;
    const std::optional<Trial> expected = course.next();
    if (!expected) return Error{"is more than the plan asks for", "give --out a new folder", file, line};
    Result<Row> row = parse_row(text.substr(at, end - at), *expected, plan, observer);
    if (!row) return std::move(row).error().in_file(file, line);
    course.answered(*row);
    read.rows.push_back(*std::move(row));
    at = end + 1;
    read.whole_bytes = at;
  }
  return read;
}

Result<TrialFile> TrialFile::append_to(const std::string& file, std::uint64_t whole_bytes) {
  std::error_code code;
  if (std::filesystem::file_size(file, code) > whole_bytes)
    std::filesystem::resize_file(file, whole_bytes, code);
  if (code) return Error{"cannot be shortened to its whole rows: " + code.message(), {}, file};
  std::ofstream opened(file, std::ios::binary | std::ios::app);
  if (!opened) return Error{"cannot be written", "give --out a folder that you may write", file};
  return TrialFile(file, std::move(opened));
}

Status TrialFile::write(const std::string& row) {
  file_ << row << '\n' << std::flush;
  if (file_) return Done{};
  return Error{"a row could not be written",
               "make room on the disk; the same command goes on from the rows before it", path_};
}

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
