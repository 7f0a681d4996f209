#include "experiments/session/session.h"

#include <dlfcn.h>
#include <fmt/format.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include <palpate/baselines.h>
#include <palpate/clock.h>
#include <palpate/read_model.h>
#include <palpate/registry.h>
#include "experiments/run/stage.h"
#include "experiments/session/version.h"
#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/parallel.h"
#include "toolkit/io/decoding.h"
#include "toolkit/metrics/machine_info.h"
#include "toolkit/prepared/cell_file.h"
#include "toolkit/spline_sdf/surface_file.h"
#include "toolkit/voronoi/voronoi.h"

namespace palpate::experiments {

render::Registry all_renderers() {
  voronoi::register_voronoi();  // first: renderers list the builders of neighbours as they are registered
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  baselines::register_baseline_renderers(registry);
  render::register_plugin_renderers(registry);
  return registry;
}

io::Readers all_readers() {
  io::Readers readers;
  io::add_standard_readers(readers);
  add_library_formats(readers);
  return readers;
}

std::string given_for_model_files(const ModelArguments& arguments) {
  for (const auto& [given, name] : {std::pair{!arguments.unit.empty(), "--unit"},
                                    {arguments.scale > 0.0, "--scale"},
                                    {arguments.post_mm > 0.0, "--post-mm"},
                                    {arguments.vertical_mm > 0.0, "--vertical-mm"},
                                    {!arguments.no_data.empty(), "--no-data"},
                                    {!arguments.within.empty(), "--within"},
                                    {!arguments.non_finite.empty(), "--non-finite"}})
    if (given) return name;
  return {};
}

Result<geometry::Aabb> parse_within(const std::string& text) {
  constexpr std::size_t kNumbers = 6;
  const std::vector<std::string> words = split_list(text);
  if (words.size() != kNumbers)
    return Error{fmt::format("--within: {} numbers are no box", words.size()),
                 "give its low corner, then its high one, in mm: --within 0,0,0,100,100,50"};
  geometry::Aabb box;
  for (std::size_t i = 0; i < kNumbers; ++i) {
    const Result<double> number = read_number(words[i], NumberRange{});
    if (!number) return Error{fmt::format("--within: {}", number.error().what), number.error().remedy};
    (i < 3 ? box.low_mm : box.high_mm)[static_cast<Eigen::Index>(i % 3)] = *number;
  }
  if (const Status right = io::check_box(box); !right)
    return Error{fmt::format("--within: {}", right.error().what), right.error().remedy};
  return box;
}

Result<scene::LoadOptions> load_options(const ModelArguments& arguments) {
  scene::LoadOptions options;
  if (!arguments.unit.empty()) {
    const Result<io::Unit> unit = io::parse_unit(arguments.unit);
    if (!unit) return unit.error();
    options.unit = *unit;
  }
  if (arguments.scale > 0.0) options.scale = arguments.scale;
  options.post_mm = arguments.post_mm;
  options.vertical_mm = arguments.vertical_mm;
  if (!arguments.no_data.empty()) {
    const Result<double> number = read_number(arguments.no_data, NumberRange{});
    if (!number)
      return Error{fmt::format("--no-data: {}", number.error().what), "give the file's number, as in -9999"};
    options.no_data = *number;
  }
  if (!arguments.within.empty()) {
    PALPATE_ASSIGN(options.within_mm, parse_within(arguments.within));
  }
  options.cleaning = &all_cleaning();
  options.threads = arguments.threads;
  if (!arguments.non_finite.empty())
    options.non_finite =
        arguments.non_finite == "refuse" ? cloud::NonFinite::kRefuse : cloud::NonFinite::kDrop;
  if (arguments.memory_limit_gb > 0.0)
    options.max_bytes = static_cast<std::uint64_t>(arguments.memory_limit_gb * kBytesPerGb);
  return options;
}

Case untimed(const RendererRequest& request) {
  Case one;
  one.name = request.label;
  one.renderer = request.name;
  one.timed = false;
  return one;
}

std::string for_shell(const std::string& argument) {
  constexpr const char* kPlain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+=:,./@%";
  if (!argument.empty() && argument.find_first_not_of(kPlain) == std::string::npos) return argument;
  std::string text = "'";
  for (const char c : argument) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return text + "'";
}

metrics::DocumentHead new_head(const std::string& command_line) {
  return {version_text(), kCommit, build_text(), metrics::machine_info(), metrics::utc_now(), command_line};
}

void add_program(metrics::MeasurementConditions& conditions) {
  conditions.compiler_flags = flags_text();
  conditions.libraries = baselines::library_versions();
  conditions.libraries.push_back(parallel_library());
}

metrics::ResultDocument new_document(const std::string& command_line) {
  metrics::ResultDocument document;
  static_cast<metrics::DocumentHead&>(document) = new_head(command_line);
  return document;
}

int fail(const Error& error, int status, ProgressBar* progress) {
  if (progress != nullptr) progress->clear();
  tell("palpate: error: {}\n", error.message());
  return status;
}

int exit_status(const Result<int>& status, Context& context) {
  if (status) return *status;
  return fail(status.error(), context.working ? kExitFellShort : kExitBadInput, &context.progress);
}

namespace {

std::mutex ending_mutex;
const std::function<bool()>* ending = nullptr;  // of the one EndOnStop, if any
int ended_by = 0;

}  // namespace

EndOnStop::EndOnStop(std::function<bool()> end) : end_(std::move(end)) {
  const std::lock_guard lock(ending_mutex);
  ending = &end_;
  ended_by = 0;
}

int EndOnStop::over() {
  const std::lock_guard lock(ending_mutex);
  ending = nullptr;
  return ended_by;
}

bool ends_on_stop(int signal) {
  const std::lock_guard lock(ending_mutex);
  if (ending == nullptr || ended_by != 0 || !(*ending)()) return false;
  ended_by = signal;
  return true;
}

RunKey::RunKey() {
  add(version_text()).add(kCommit).add(build_text());
  // Two builds of one commit may differ.
  struct stat program {};
  if (::stat("/proc/self/exe", &program) == 0)
    add(static_cast<std::uint64_t>(program.st_size))
        .add(static_cast<std::uint64_t>(program.st_mtim.tv_sec))
        .add(static_cast<std::uint64_t>(program.st_mtim.tv_nsec));
  const metrics::MachineInfo machine = metrics::machine_info();
  add(machine.cpu).add(static_cast<std::uint64_t>(machine.cores));
}

RunKey& RunKey::add(std::string_view text) {
  hash_.u64(text.size());
  hash_.bytes(std::as_bytes(std::span(text)));
  return *this;
}

RunKey& RunKey::add(double value) {
  hash_.real(value);
  return *this;
}

RunKey& RunKey::add(std::uint64_t value) {
  hash_.u64(value);
  return *this;
}

RunKey& RunKey::add_file(const std::string& path) {
  add(path);
  Result<InputFile> file = InputFile::open(path);
  if (!file) return *this;
  std::vector<std::byte> piece(std::size_t{1} << 20);
  const std::vector<std::byte> first = first_bytes(path);
  if (prepared::CellFile::begins_as_one(first) || spline_sdf::SurfaceFile::begins_as_one(first)) {
    // Its ends have a checksum of its table, which has one of each part. All may be 25 GB.
    const std::uint64_t size = file->size();
    piece.resize(static_cast<std::size_t>(std::min<std::uint64_t>(size, piece.size())));
    add(size);
    for (const std::uint64_t at : {std::uint64_t{0}, size - piece.size()})
      if (file->read_at(at, piece)) hash_.bytes(piece);
    return *this;
  }
  for (;;) {
    const Result<std::size_t> got = file->read(piece);
    if (!got || *got == 0) return *this;
    hash_.bytes(std::span(piece).first(*got));
  }
}

std::string key_of(const RendererRequest& request) {
  RunKey key;
  key.add(request.name).add(cleaning_text(request.clean));
  for (const auto& [name, value] : request.options.all()) key.add(name).add(value);
  return key.word();
}

namespace {

// Only headers of the formats are included here: the libraries are the module's.
constexpr const char* kModule = "palpate-formats.so";
constexpr const char* kEntry = "palpate_add_formats";

Result<io::Readers> load() {
  // Never closed: readers of its own live as long as the program.
  void* const module = dlopen(kModule, RTLD_NOW | RTLD_LOCAL);
  void* const entry = module == nullptr ? nullptr : dlsym(module, kEntry);
  if (entry == nullptr) {
    const char* const why = dlerror();
    return Error{
        fmt::format("this format's libraries cannot be loaded: {}", why == nullptr ? "no entry" : why),
        "install Palpate's lib folder beside its bin folder, and the packages of cmake/packages.txt"};
  }
  io::Readers readers;
  reinterpret_cast<void (*)(io::Readers&)>(entry)(readers);
  return readers;
}

[[maybe_unused]] void add_lazily(io::Readers& readers, const char* extension) {
  readers.add({extension}, [extension](const io::ReaderInput& input) -> Result<io::DecodedFile> {
    static const Result<io::Readers> loaded = load();
    if (!loaded) return loaded.error();
    return (*loaded->find(extension))(input);
  });
}

}  // namespace

void add_library_formats([[maybe_unused]] io::Readers& readers) {
#ifdef PALPATE_WITH_PCD
  add_lazily(readers, pcd::kPcdExtension);
#endif
#ifdef PALPATE_WITH_DEM
  for (const char* extension : dem::kDemExtensions) add_lazily(readers, extension);
#endif
}

std::size_t terminal_columns(int descriptor) {
  constexpr std::size_t kDefault = 80, kMost = 10'000;
  if (const char* const set = std::getenv("COLUMNS"); set != nullptr) {
    const std::string_view text(set);
    std::size_t columns = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), columns);
    if (error == std::errc() && end == text.data() + text.size() && columns > 0 && columns <= kMost)
      return columns;
  }
  winsize size{};
  if (::ioctl(descriptor, TIOCGWINSZ, &size) == 0 && size.ws_col > 0) return size.ws_col;
  return kDefault;
}

void print_tables(const std::vector<Table>& tables, bool whole) {
  std::string text;
  for (const Table& table : tables) text += to_text(table, terminal_columns(STDOUT_FILENO)) + "\n";
  if (whole || tables.empty()) return fmt::print("{}", text);
  // Text below a table explains it: in the report it does too.
  const std::size_t lines = static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
  text.erase(0, text.find_first_not_of('\n'));
  std::size_t at = 0, kept = 0;
  for (; kept < kBriefLines && at < text.size() && text[at] != '\n'; ++kept) at = text.find('\n', at) + 1;
  fmt::print("{}", text.substr(0, at));
  if (kept < lines) fmt::print("{} lines more: --verbose, or the report\n", lines - kept);
}

void tell_lines(const std::vector<std::string>& lines, bool all) {
  // With a table's kBriefLines, the line on what it leaves out and the report's they are fifteen at most.
  constexpr std::size_t kToldLines = 3;
  const std::size_t told = all || lines.size() <= kToldLines ? lines.size() : kToldLines - 1;
  for (std::size_t i = 0; i < told; ++i) tell("palpate: {}\n", lines[i]);
  if (told < lines.size()) tell("palpate: {} more: --verbose, or the report\n", lines.size() - told);
}

void print_answer(const Headline& answer) {
  for (const std::string& line : wrapped(answer.lead + (answer.lead == "Take" ? " " : ": ") + answer.text,
                                         terminal_columns(STDOUT_FILENO)))
    fmt::print("{}\n", line);
}

namespace {

/// With a line on what is left out, the finding and the report's: 15.
constexpr std::ptrdiff_t kScoreLines = 9;

/// Without what each renderer is and without marks, whose legend takes lines; of several faults the first.
void shorten(Table& table) {
  table.columns.erase(table.columns.begin() + 1);
  for (std::vector<Cell>& row : table.rows) {
    row.erase(row.begin() + 1);
    for (Cell& cell : row) {
      cell.best = cell.bad = false;
      if (const std::size_t end = cell.text.find(", "); end != std::string::npos)
        cell.text.replace(end, std::string::npos, ", ..");
    }
  }
}

}  // namespace

void print_scores(const metrics::ResultDocument& document, bool whole) {
  if (whole) print_tables({comparison_table(document)}, true);
  Table table = summary_table(document);
  const std::size_t rows = table.rows.size(), columns = terminal_columns(STDOUT_FILENO);
  if (!whole) shorten(table);
  std::string text = to_text(table, columns);
  while (!whole && table.rows.size() > 1 && std::count(text.begin(), text.end(), '\n') > kScoreLines) {
    table.rows.pop_back();
    text = to_text(table, columns);
  }
  const std::size_t left_out = rows - table.rows.size();
  fmt::print("{}{}\n", text, left_out > 0 ? fmt::format("{} more: --verbose, or the report", left_out) : "");
  print_answer(answer_of(document));
}

namespace {

constexpr std::int64_t kSilentNs = 1'000'000'000;  // shorter work needs no bar
constexpr std::int64_t kRedrawNs = 100'000'000;    // ten times a second
constexpr std::int64_t kLogNs = 5'000'000'000;     // a line of a log stands for so long
constexpr double kBelievableFraction = 0.02;       // before that a time left would only jump about
constexpr int kBarCells = 24;

std::string seconds(double s) {
  constexpr int kMinute = 60;
  const int whole = static_cast<int>(s + 0.5);
  return whole < kMinute ? fmt::format("{} s", whole)
                         : fmt::format("{} min {:02} s", whole / kMinute, whole % kMinute);
}

}  // namespace

ProgressBar::ProgressBar() : terminal_(::isatty(STDERR_FILENO) == 1) {}

ProgressBar::~ProgressBar() {
  clear();
}

void ProgressBar::clear() {
  if (drawn_) std::fputs("\r\033[K", stderr);
  drawn_ = false;
}

void ProgressBar::report(std::string_view what, double fraction) {
  const std::int64_t now = monotonic_ns();
  if (!terminal_) {
    // A log gets a plain line now and then, so that a long job is not taken for a dead one.
    if (prefix_.empty() || now - last_draw_ns_ < kLogNs || phase_ == what) return;
    last_draw_ns_ = now;
    phase_ = what;
    tell("{}{}\n", prefix_, phase_);
    return;
  }
  if (phase_ != what) {
    phase_ = what;
    // A phase whose text changes with every report ("12.3 MB") goes on from where it began.
    if (fraction >= 0.0 || phase_start_ns_ == 0) phase_start_ns_ = now;
  }
  if (now - phase_start_ns_ < kSilentNs || now - last_draw_ns_ < kRedrawNs) return;
  last_draw_ns_ = now;
  const double elapsed_s = static_cast<double>(now - phase_start_ns_) * 1e-9;
  std::string line = prefix_ + phase_;
  if (fraction >= 0.0) {
    const double f = std::clamp(fraction, 0.0, 1.0);
    const auto filled = static_cast<std::size_t>(f * kBarCells);
    line += fmt::format("  [{}{}] {:3.0f} %", std::string(filled, '#'), std::string(kBarCells - filled, '.'),
                        100.0 * f);
    if (f > kBelievableFraction) line += fmt::format("  {} left", seconds(elapsed_s * (1.0 - f) / f));
  } else {
    line += fmt::format("  {}", seconds(elapsed_s));
  }
  tell("\r\033[K{}", line.substr(0, terminal_columns(STDERR_FILENO) - 1));
  std::fflush(stderr);
  drawn_ = true;
}

}  // namespace palpate::experiments
