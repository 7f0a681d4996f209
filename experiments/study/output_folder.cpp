#include "experiments/study/study.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <sstream>
#include <vector>

#include <palpate/progress.h>
#include <palpate/result.h>
#include "toolkit/core/files.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {

namespace fs = std::filesystem;

namespace {

constexpr const char* kMarkText = "Results of Palpate: the files below are replaced by the next run.";
constexpr const char* kProcess = "process ";
constexpr const char* kUnfinished = "unfinished ";  // followed by the run's key, a blank and its record
constexpr const char* kFile = "file ";
constexpr const char* kParts = ".palpate-parts/";

std::string text_of(const fs::path& path) {
  const Result<std::string> text = read_file(path.string(), kMemoryLimitBytes);
  return text ? *text : std::string();
}

std::string hash_of(const fs::path& path) {
  const std::string text = text_of(path);
  Hash64 hash;
  hash.bytes(std::as_bytes(std::span(text)));
  return hash.hex();
}

/// Rejects names in the mark that lead out of the folder.
bool is_inside(const std::string& name) {
  const fs::path path = name;
  return !name.empty() && path.is_relative() && std::find(path.begin(), path.end(), "..") == path.end();
}

/// The record that stands behind an incomplete run's key; empty: it has none.
std::string record_in(const std::string& unfinished) {
  const std::size_t blank = unfinished.find(' ');
  return blank == std::string::npos ? std::string() : unfinished.substr(blank + 1);
}

Status write_all(int fd, std::string_view text) {
  while (!text.empty()) {
    const ssize_t n = ::write(fd, text.data(), text.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return Error{fmt::format("cannot be written: {}", std::strerror(errno))};
    text.remove_prefix(static_cast<std::size_t>(n));
  }
  // Syncs the list: it must name every file that survives a power cut.
  if (::fdatasync(fd) != 0 && errno != EINVAL && errno != EROFS)
    return Error{fmt::format("cannot be written: {}", std::strerror(errno))};
  return Done{};
}

}  // namespace

struct OutputFolder::State {
  fs::path root;
  LockedFile mark;
  bool made_mark = false;      ///< the mark is new
  bool no_list = false;        ///< the mark is of a version without a file list
  std::vector<fs::path> made;  ///< created folders, outermost first
  std::string unfinished;      ///< key and record of an incomplete last run
  std::string record;          ///< a file that is a part from its first case on
  bool begun = false, resumed = false, completed = false;
  bool amended = false;           ///< reopened
  std::set<std::string> ours;     ///< files of this and earlier runs
  std::set<std::string> claimed;  ///< files of this run
  std::set<std::string> since;    ///< claimed since the part started
  std::set<std::string> parts;    ///< completed parts, and the record
  StopCallback stop_callback;

  State() = default;
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  ~State() {
    stop_callback.drop();
    if (begun && !completed && !resumed && parts.empty())
      for (const std::string& name : claimed) remove(name);
    give_back();
  }

  /// Removes what was created if nothing remains here.
  void give_back() noexcept {
    std::error_code code;
    if (!made_mark || completed || resumed || !parts.empty()) return;
    fs::remove(root / kFolderMark, code);
    for (auto folder = made.rbegin(); folder != made.rend(); ++folder) fs::remove(*folder, code);
  }
  std::string describe_stopped() {
    if (completed) return {};
    if (amended) return fmt::format("{} is as it was, but for files that were written anew", root.string());
    if (!begun) {
      give_back();
      return fmt::format("nothing was changed in {}", root.string());
    }
    if (parts.empty()) return fmt::format("nothing is complete yet in {}", root.string());
    return fmt::format("complete and kept in {}: {}; the same command goes on from there", root.string(),
                       joined({parts.begin(), parts.end()}));
  }

  Error wrong(std::string what, std::string remedy = "give --out a place you may write") const {
    return Error{std::move(what), std::move(remedy), root.string()};
  }
  Status lock();
  void read_mark();
  /// Overwrites the text first and truncates it second, so names are always listed.
  Status write_mark() const;
  Status append(const std::string& line) const;
  /// Removes one of our files, and its folder if empty.
  void remove(const std::string& name) const noexcept;
};

Status OutputFolder::State::lock() {
  Result<LockedFile> locked = LockedFile::open((root / kFolderMark).string());
  if (!locked) return wrong("the folder cannot be written: " + locked.error().what);
  if (locked->held()) {
    mark = *std::move(locked);
    return Done{};
  }
  made_mark = false;  // belongs to the other handle
  std::istringstream lines(text_of(root / kFolderMark));
  std::string line, process = "of another process";
  while (std::getline(lines, line))
    if (line.starts_with(kProcess)) process = line;
  return wrong(fmt::format("another run is writing to this folder ({})", process),
               "wait for it to end, or give --out another name");
}

void OutputFolder::State::read_mark() {
  const std::string text = text_of(root / kFolderMark);
  std::istringstream lines(text);
  std::string line;
  while (std::getline(lines, line)) {
    if (line.starts_with(kUnfinished)) unfinished = line.substr(std::strlen(kUnfinished));
    if (line.starts_with(kFile) && is_inside(line.substr(std::strlen(kFile))))
      ours.insert(line.substr(std::strlen(kFile)));
  }
  no_list = !text.empty() && !text.starts_with(kMarkText);
  if (no_list) ours = {"result.json", "report.html"};
}

Status OutputFolder::State::write_mark() const {
  std::string text = fmt::format("{}\n{}{}\n", kMarkText, kProcess, ::getpid());
  if (!unfinished.empty()) text += kUnfinished + unfinished + "\n";
  for (const std::string& name : ours) text += kFile + name + "\n";
  ::lseek(mark.fd(), 0, SEEK_SET);
  if (const Status written = write_all(mark.fd(), text); !written) return wrong(written.error().what);
  if (::ftruncate(mark.fd(), static_cast<off_t>(text.size())) != 0)
    return wrong(fmt::format("cannot be written: {}", std::strerror(errno)));
  return Done{};
}

Status OutputFolder::State::append(const std::string& line) const {
  ::lseek(mark.fd(), 0, SEEK_END);
  if (const Status written = write_all(mark.fd(), line + "\n"); !written) return wrong(written.error().what);
  return Done{};
}

void OutputFolder::State::remove(const std::string& name) const noexcept {
  std::error_code code;
  const fs::path path = root / name;
  if (fs::is_directory(fs::symlink_status(path, code))) return;
  fs::remove(path, code);
  if (path.parent_path() != root && fs::is_empty(path.parent_path(), code))
    fs::remove(path.parent_path(), code);
}

Result<OutputFolder> OutputFolder::open(const std::string& folder) {
  auto state = std::make_shared<State>();
  std::error_code code;
  fs::path& root = state->root;
  root = fs::path(folder).lexically_normal();
  if (!root.has_filename()) root = root.parent_path();  // "out/"
  if (fs::exists(root, code) && !fs::is_directory(root, code))
    return state->wrong("is a file, and the results need a folder", "give --out another name");
  const auto hold = block_stop();
  for (fs::path missing = root; !missing.empty() && !fs::exists(missing, code);
       missing = missing.parent_path())
    state->made.insert(state->made.begin(), missing);
  state->made_mark = !fs::exists(root / kFolderMark, code);
  fs::create_directories(root, code);
  if (code) return state->wrong("the folder cannot be made: " + code.message());
  if (state->made_mark && !fs::is_empty(root, code))
    return state->wrong("the folder holds files that are not results of Palpate",
                        "give --out a new or an empty folder");
  PALPATE_TRY(state->lock());
  state->read_mark();
  PALPATE_TRY(state->write_mark());
  state->stop_callback = StopCallback([s = state.get()] { return s->describe_stopped(); });
  return OutputFolder(std::move(state), {});
}

Result<OutputFolder> OutputFolder::reopen(const std::string& folder) {
  fs::path root = fs::absolute(folder).lexically_normal(), below;
  if (!root.has_filename()) root = root.parent_path();
  std::error_code code;
  if (!fs::exists(root / kFolderMark, code) && fs::exists(root.parent_path() / kFolderMark, code)) {
    below = root.filename();
    root = root.parent_path();
  }
  if (!fs::exists(root / kFolderMark, code))
    return Error{fmt::format("is no folder of results: there is no {} in it", kFolderMark),
                 "copy the whole folder, hidden files too", folder};
  Result<OutputFolder> opened = open(root.string());
  if (!opened) return opened;
  opened->state_->amended = true;
  return below.empty() ? opened : opened->inside(below.string());
}

Status OutputFolder::check_not_read(std::span<const std::string> files) const {
  std::error_code code;
  for (const std::string& file : files)
    for (const std::string& name : state_->ours)
      if (fs::equivalent(state_->root / name, file, code))
        return Error{
            fmt::format("is read by this run, and is a result that the next run with --out {} replaces",
                        state_->root.string()),
            "give --out another folder, or copy the file out of it", file};
  return Done{};
}

Result<OutputFolder::Begun> OutputFolder::begin(const std::string& key, const std::string& record) const {
  const auto hold = block_stop();
  State& s = *state_;
  const std::string own = record.empty() ? key : key + " " + record;
  const bool interrupted = !s.unfinished.empty();
  if (!record.empty() && !interrupted && !s.ours.empty() && !s.ours.contains(record))
    return s.wrong(fmt::format("the folder holds other results, and no {}", record),
                   "give --out a new folder, or that of an earlier run of this command");
  const std::string left = interrupted ? record_in(s.unfinished) : record;
  std::set<std::string> parts;
  std::error_code code;
  for (const std::string& name : s.ours) {
    if (interrupted && name.starts_with(kParts)) parts.insert(name.substr(std::strlen(kParts)));
    if (name == left && fs::exists(s.root / name, code)) parts.insert(name);
  }
  if (interrupted && !parts.empty() && s.unfinished != own)
    return s.wrong("an interrupted run in it was of something else (scene, path, options or program)",
                   "give that run's command to go on with it, or --out another folder; to begin anew, remove "
                   "this folder");
  s.begun = true;
  s.parts = std::move(parts);
  s.resumed = !s.parts.empty();
  s.record = record;
  if (!s.resumed) {
    for (const std::string& name : s.ours) s.remove(name);
    s.ours.clear();
  } else if (!record.empty()) {
    s.claimed = s.ours;
    std::erase_if(s.claimed, [](const std::string& name) { return name.starts_with(kParts); });
  }
  s.unfinished = own;
  PALPATE_TRY(s.write_mark());
  return !s.resumed ? Begun::kAnew : interrupted ? Begun::kGoesOn : Begun::kGoesOnFromComplete;
}

void OutputFolder::start_part() const {
  state_->since.clear();
}

Status OutputFolder::keep(const std::string& part, const std::string& key, const std::string& text) const {
  State& s = *state_;
  nlohmann::ordered_json kept = {{"key", key}, {"files", nlohmann::ordered_json::object()}, {"text", text}};
  std::error_code code;
  for (const std::string& name : s.since)
    if (fs::exists(s.root / name, code)) kept["files"][name] = hash_of(s.root / name);
  fs::create_directories(s.root / kParts, code);
  const std::string name = kParts + part;
  if (s.ours.insert(name).second) PALPATE_TRY(s.append(kFile + name));
  const std::string all = kept.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
  PALPATE_TRY(palpate::write_file((s.root / name).string(), all));
  const auto hold = block_stop();
  s.parts.insert(part);
  return Done{};
}

bool OutputFolder::take_over(const std::string& part, const std::string& key,
                             const std::function<bool(const std::string& text)>& use) const {
  State& s = *state_;
  if (!s.resumed) return false;
  const nlohmann::json kept = nlohmann::json::parse(text_of(s.root / kParts / part), nullptr, false);
  const auto text = [&](const char* name) {
    return kept.contains(name) && kept[name].is_string() ? kept[name].get<std::string>() : std::string();
  };
  if (!kept.is_object() || !kept.contains("files") || text("key") != key) return false;
  for (const auto& [name, hash] : kept["files"].items())
    if (!s.ours.contains(name) || hash != hash_of(s.root / name)) return false;
  if (!use(text("text"))) return false;
  const auto hold = block_stop();
  for (const auto& [name, hash] : kept["files"].items()) s.claimed.insert(name);
  return true;
}

bool OutputFolder::has_parts() const {
  return !state_->parts.empty();
}

Status OutputFolder::adopt(const std::string& folder) const {
  State& s = *state_;
  State other;
  other.root = folder;
  other.read_mark();
  if (other.unfinished.empty()) return Done{};  // stopped before it began
  if (other.unfinished != s.unfinished)
    return Error{"was measured by another program or kind of machine, or with other arguments",
                 "measure and merge on machines of one kind, or remove the folder", folder};
  for (const std::string& name : other.ours) {
    if (!name.starts_with(kParts)) continue;
    const nlohmann::json kept = nlohmann::json::parse(text_of(other.root / name), nullptr, false);
    if (!kept.is_object() || !kept.contains("files") || !kept.contains("text")) continue;  // measured anew
    bool whole = kept["files"].is_object();
    for (const auto& [file, hash] : kept["files"].items())
      whole = whole && is_inside(file) && hash == hash_of(other.root / file);
    if (!whole) continue;  // the same
    start_part();
    for (const auto& [file, hash] : kept["files"].items()) {
      PALPATE_ASSIGN(const std::string path, claim(file));
      std::error_code code;
      fs::create_directories(fs::path(path).parent_path(), code);
      fs::copy_file(other.root / file, path, fs::copy_options::overwrite_existing, code);
      if (code) return Error{"cannot be copied from " + folder + ": " + code.message(), {}, path};
    }
    PALPATE_TRY(keep(name.substr(std::strlen(kParts)), kept.value("key", ""), kept.value("text", "")));
    s.resumed = true;
  }
  return Done{};
}

Status OutputFolder::complete() const {
  const auto hold = block_stop();
  State& s = *state_;
  s.unfinished.clear();
  PALPATE_TRY(s.write_mark());
  s.completed = true;
  for (const std::string& name : s.ours)
    if (!s.claimed.contains(name)) s.remove(name);
  s.ours = s.claimed;
  return s.write_mark();
}

fs::path OutputFolder::path() const {
  return below_.empty() ? state_->root : state_->root / below_;
}

Result<std::string> OutputFolder::claim(const std::string& name) const {
  State& s = *state_;
  const std::string own = below_ + name;
  std::error_code code;
  if (!s.ours.contains(own)) {
    if (!s.no_list && fs::exists(fs::symlink_status(s.root / own, code)))
      return Error{"is there already, and Palpate did not write it",
                   "move it away, or give --out another folder", (s.root / own).string()};
    PALPATE_TRY(s.append(kFile + own));
    s.ours.insert(own);
  }
  s.claimed.insert(own);
  s.since.insert(own);  // again where a part is kept anew
  if (own == s.record) {
    const auto hold = block_stop();
    s.parts.insert(own);
  }
  return (s.root / own).string();
}

Status OutputFolder::write(const std::string& name, std::string_view text) const {
  PALPATE_ASSIGN(const std::string path, claim(name));
  return palpate::write_file(path, text);
}

Result<OutputFolder> OutputFolder::inside(const std::string& name) const {
  std::error_code code;
  fs::create_directories(path() / name, code);
  if (code) return Error{"the folder cannot be made: " + code.message(), {}, (path() / name).string()};
  return OutputFolder(state_, below_ + name + "/");
}

}  // namespace palpate::experiments
