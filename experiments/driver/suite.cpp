#include "experiments/driver/suite.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <utility>

#include <palpate/result.h>
#include "experiments/session/session.h"
#include "experiments/study/study.h"
#include "toolkit/core/files.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/messages.h"
#include "toolkit/metrics/result_keys.h"

namespace palpate::experiments {

namespace fs = std::filesystem;

DocumentJson begin_json(const char* schema, const metrics::DocumentHead& head) {
  DocumentJson json = {{"schema", schema}};
  json.update(DocumentJson::parse(metrics::head_json(head)));
  return json;
}

DocumentJson text_or_null(const std::string& text) {
  return text.empty() ? DocumentJson(nullptr) : DocumentJson(text);
}

std::string document_text(const DocumentJson& json) {
  return json.dump(1, ' ', false, DocumentJson::error_handler_t::replace) + "\n";
}

Status Suite::open(const std::string& out, std::span<const std::string> read) {
  const std::string& only = context_.cases.only;
  if (only.find('/') != std::string::npos || only == "..")
    return Error{"there is no case " + shown(only), "jobs.tsv lists them"};
  const fs::path folder = only.empty() ? fs::path(out) : fs::path(out) / kJobsFolder / kCasesFolder / only;
  PALPATE_ASSIGN(folder_, OutputFolder::open(folder.string()));
  return folder_->check_not_read(read);
}

Status Suite::begin(const RunKey& key, const std::string& record) {
  PALPATE_ASSIGN(const OutputFolder::Begun begun, folder_->begin(key.word(), record));
  context_.working = true;
  context_.cases.anew = begun == OutputFolder::Begun::kAnew;
  for (const std::string& mark : files_of_cases(kFolderMark))
    PALPATE_TRY(folder_->adopt(fs::path(mark).parent_path().string()));
  if (begun != OutputFolder::Begun::kGoesOn || partial()) return Done{};
  progress().clear();
  tell("palpate: {}: going on from an interrupted run\n", folder_->path().string());
  return Done{};
}

bool Suite::measures(const Case& one) const {
  CaseSelection& cases = context_.cases;
  if (cases.list) cases.left.push_back(one);
  cases.found = cases.found || case_id(one.name) == cases.only;
  return cases.all() || case_id(one.name) == cases.only;
}

Result<int> Suite::leave() const {
  CaseSelection& cases = context_.cases;
  progress().clear();
  if (!cases.list) {
    if (cases.found || cases.only == kNoCase || folder_->has_parts()) return kExitOk;
    context_.working = false;  // bad input
    return Error{"there is no case " + shown(cases.only), "jobs.tsv lists them"};
  }
  PALPATE_ASSIGN(cases.written, write_jobs(cases, folder_->path()));
  // The folder stays ours for the jobs, which find in it what an earlier run has kept.
  if (cases.anew) PALPATE_TRY(folder_->complete());
  return kExitOk;
}

std::vector<std::string> Suite::files_of_cases(const std::string& name) const {
  std::vector<std::string> files;
  std::error_code code;
  if (partial()) return files;
  for (const fs::directory_entry& entry :
       fs::directory_iterator(folder_->file(kJobsFolder) / kCasesFolder, code))
    if (fs::exists(entry.path() / name, code)) files.push_back((entry.path() / name).string());
  std::sort(files.begin(), files.end());
  return files;
}

Status Suite::write(const SuiteResults& results, const Page& page) const {
  PALPATE_TRY(folder_->write(results.file, results.json));
  PALPATE_TRY(keep_page(page, *folder_));
  return folder_->complete();
}

Status Suite::publish(const SuiteResults& results, const Page& page, bool json) const {
  PALPATE_TRY(write(results, page));
  progress().clear();
  if (json)
    fmt::print("{}", results.json);
  else
    print_tables(results.tables, context_.verbose);
  std::fflush(stdout);
  std::vector<std::string> told;
  for (const std::string& fault : results.faults) told.push_back("fault: " + fault);
  for (const std::string& warning : results.warnings) told.push_back("warning: " + warning);
  tell_lines(told, json || context_.verbose);
  if (!json) fmt::print("report: {}\n", std::filesystem::absolute(folder_->file(kReportFile)).string());
  return Done{};
}

namespace fs = std::filesystem;

namespace {

// Seconds a point and bytes a point of a preparation, seconds a frame: the goals of the design where points
// are touched; advancing front and Embree where a mesh is made of them.
constexpr double kPointsPrepareS = 1e-6, kPointsBytes = 100.0, kPointsFrameS = 0.3e-6;
constexpr double kMeshPrepareS = 25e-6, kMeshBytes = 1000.0, kMeshFrameS = 5e-6;
// A process with its libraries, and the seconds in which it starts and makes scene and truth.
constexpr double kProgramMegabytes = 150.0, kProgramS = 0.5;
constexpr double kBytesPerMegabyte = 1e6;

// Each job gets five minutes and ten times what it is expected to take, and twice its memory; a repeated one
// gets as much again.
constexpr const char* kSnakefile =
    R"(# Written by palpate: the same command writes it anew. Snakemake 7 and later.
import csv

with open(workflow.basedir + "/jobs.tsv", newline="") as table:
    JOBS = {row["id"]: row for row in csv.DictReader(table, delimiter="\t")}


def timed(wildcards):
    return int(JOBS[wildcards.id]["timed"])


def megabytes(wildcards, attempt):
    return 200 + 2 * attempt * int(JOBS[wildcards.id]["MB"])


def minutes(wildcards, attempt):
    return attempt * (5 + int(JOBS[wildcards.id]["seconds"]) // 6)


def alone(wildcards):
    return "--exclusive" if timed(wildcards) else "--oversubscribe"


localrules:
    report,


rule report:
    input:
        "done/merge",
    output:
        touch("done/report"),
    shell:
        "ls -1 ../report.html"


rule prepare:
    output:
        "done/prepare",
    retries: 2
    resources:
        timing=0,
        mem_mb=lambda wildcards, attempt: attempt * 2000,
        runtime=30,
        slurm_extra="--oversubscribe",
    shell:
        "sh run {output} --case none"


rule case:
    input:
        "done/prepare",
    output:
        "done/cases/{id}",
    retries: 2
    resources:
        timing=timed,
        mem_mb=megabytes,
        runtime=minutes,
        slurm_extra=alone,
    shell:
        "sh run {output} --case {wildcards.id}"


rule merge:
    input:
        expand("done/cases/{id}", id=JOBS),
    output:
        "done/merge",
    retries: 2
    resources:
        timing=1,
        mem_mb=lambda wildcards, attempt: attempt * 4000,
        runtime=60,
        slurm_extra="--exclusive",
    shell:
        "sh run {output}"
)";

// One job that is timed at a time.
constexpr const char* kLocalProfile = R"(cores: all
resources:
  - timing=1
)";
// Partition and account come from the user's SBATCH_PARTITION and SBATCH_ACCOUNT; from 8 on Snakemake names
// both to sbatch itself, so that they are its default resources slurm_partition and slurm_account.
constexpr const char* kSlurm7 = R"(cluster: >-
  sh profiles/slurm/submit {resources.slurm_extra} {resources.mem_mb} {resources.runtime} {rule} {output} {wildcards}
cluster-status: sh profiles/slurm/status
cluster-cancel: scancel
)";
constexpr const char* kSlurm8 = "executor: slurm\n";
constexpr const char* kSlurmJobs = R"(jobs: 1000
resources:
  - timing=1000
latency-wait: 60
)";
// Times of files decide alone what is to be done again. The mark of an ended job is whole where it exists: a
// Snakemake that was killed finds its jobs in the queue again.
constexpr const char* kEveryProfile = R"(rerun-triggers: mtime
ignore-incomplete: true
keep-going: true
quiet: rules
)";
// A job is what its rule runs: Snakemake itself, started in every job, would take seconds of it.
constexpr const char* kSlurmSubmit =
    R"(# How Snakemake 7 submits a job; its own script is the last argument, and unused.
extra=$1 memory=$2 minutes=$3 rule=$4 output=$5
shift 5
case $rule in
  prepare) set -- --case none ;;
  case) set -- --case "${1#id=}" ;;
  *) set -- ;;
esac
mkdir -p logs
exec sbatch --parsable --no-requeue "$extra" --ntasks=1 --mem="$memory" --time="$minutes" --job-name="palpate-$rule" \
  --open-mode=append --output=logs/%j.log --wrap="sh run $output $*"
)";
// Slurm forgets a job minutes after its end. One that nobody knows counts as failed: what it measured is
// kept.
constexpr const char* kSlurmStatus = R"(# What Snakemake 7 asks of a job: success, running or failed.
state=$(scontrol --oneliner show job "$1" 2> /dev/null | sed -n 's/.* JobState=\([A-Z_]*\).*/\1/p' | tail -n 1)
[ -n "$state" ] || state=$(sacct -nXPo State -j "$1" 2> /dev/null | tail -n 1)
case $state in
  COMPLETED) echo success ;;
  PENDING | CONFIGURING | RUNNING | COMPLETING | SUSPENDED | REQUEUED | REQUEUE*) echo running ;;
  *) echo failed ;;
esac
)";

// Exit status 1 is an answer: the command says at the end what could not be measured.
std::string run_script(const std::string& command) {
  return fmt::format(
      "# A job: sh run FILE [--case ID], where FILE says that it has ended.\n"
      "ended=$1\nshift\n(cd {} && exec {} \"$@\")\nstatus=$?\n"
      "[ $status -le 1 ] || exit $status\nmkdir -p \"$(dirname \"$ended\")\" && touch \"$ended\"\n",
      for_shell(fs::current_path().string()), command);
}

/// The text in the last "KEY=" of a setting or scene; "-" where there is none.
std::string seed_in(const std::string& text) {
  constexpr const char* kSeed = "seed=";
  const std::size_t at = text.rfind(kSeed);
  if (at == std::string::npos) return "-";
  const std::size_t from = at + std::strlen(kSeed);
  return text.substr(from, text.find_first_of(":,/ ", from) - from);
}

/// A field of a table with tabs.
std::string field(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c == '\t' || c == '\n' || c == '"'; }, ' ');
  return text.empty() ? "-" : text;
}

std::string table_of(const std::vector<Case>& cases) {
  std::string text = "id\tscene\trenderer\tsetting\tseed\tseconds\tMB\ttimed\n";
  for (const Case& one : cases)
    text += fmt::format("{}\t{}\t{}\t{}\t{}\t{:.0f}\t{:.0f}\t{:d}\n", case_id(one.name), field(one.scene),
                        field(one.renderer), field(one.setting.empty() ? one.name : one.setting),
                        field(seed_in(one.scene + " " + one.setting)), std::ceil(one.seconds),
                        std::ceil(one.megabytes), one.timed);
  return text;
}

}  // namespace

std::string case_id(const std::string& name) {
  constexpr const char* kPlain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-.";
  constexpr std::size_t kMostLetters = 60, kHashLetters = 8;
  std::string id = name.substr(0, kMostLetters);
  for (std::size_t at = 0; (at = id.find_first_not_of(kPlain, at)) != std::string::npos;) id[at] = '_';
  if (id == name && !id.empty() && id != kNoCase && !id.starts_with('.')) return id;
  Hash64 hash;
  hash.bytes(std::as_bytes(std::span(name)));
  return "c" + id + "-" + hash.hex().substr(0, kHashLetters);
}

Case case_of(const RendererRequest& request, const render::RendererInfo& info, const std::string& scene,
             std::size_t points, double frames, double preparations) {
  const bool mesh = info.geometry == render::Geometry::kMesh;
  const auto n = static_cast<double>(points);
  Case one;
  one.name = request.label;
  one.scene = scene;
  one.renderer = request.name;
  one.seconds = kProgramS + preparations * n * (mesh ? kMeshPrepareS : kPointsPrepareS) +
                frames * (mesh ? kMeshFrameS : kPointsFrameS);
  one.megabytes = kProgramMegabytes + n * (mesh ? kMeshBytes : kPointsBytes) / kBytesPerMegabyte;
  return one;
}

Result<std::string> write_jobs(const CaseSelection& cases, const fs::path& out) {
  const fs::path jobs = fs::absolute(out) / kJobsFolder;
  PALPATE_ASSIGN(const OutputFolder folder, OutputFolder::open(jobs.string()));
  PALPATE_ASSIGN([[maybe_unused]] const OutputFolder::Begun begun, folder.begin(RunKey().add("jobs").word()));
  std::error_code code;
  fs::remove_all(jobs / "done", code);  // of ours: what belongs to others was refused
  PALPATE_TRY(folder.write("jobs.tsv", table_of(cases.left)));
  PALPATE_TRY(folder.write("Snakefile", kSnakefile));
  PALPATE_TRY(folder.write("run", run_script(cases.command)));
  PALPATE_ASSIGN(const OutputFolder profiles, folder.inside("profiles"));
  PALPATE_ASSIGN(const OutputFolder local, profiles.inside("local"));
  PALPATE_TRY(local.write("config.yaml", std::string(kLocalProfile) + kEveryProfile));
  PALPATE_ASSIGN(const OutputFolder slurm, profiles.inside("slurm"));
  const std::string queued = std::string(kSlurmJobs) + kEveryProfile;
  PALPATE_TRY(slurm.write("config.yaml", kSlurm7 + queued));
  PALPATE_TRY(slurm.write("config.v8+.yaml", kSlurm8 + queued));
  PALPATE_TRY(slurm.write("submit", kSlurmSubmit));
  PALPATE_TRY(slurm.write("status", kSlurmStatus));
  PALPATE_TRY(folder.complete());
  tell("palpate: {} cases: cd {} && snakemake --profile profiles/{}\n", cases.left.size(),
       for_shell(jobs.string()), cases.run ? "local" : "local, or profiles/slurm");
  return jobs.string();
}

Error run_jobs(const std::string& folder) {
  const Error without{"Snakemake cannot be started: ", "install the package snakemake; the jobs are written",
                      folder};
  Error error = without;
  if (::chdir(folder.c_str()) == 0) {
    std::signal(SIGPIPE, SIG_DFL);
    ::execlp("snakemake", "snakemake", "--profile", "profiles/local", static_cast<char*>(nullptr));
  }
  error.what += std::strerror(errno);
  return error;
}

namespace {

constexpr const char* kPageSchema = "palpate-page/1";
constexpr const char* kFigures = "figures";

/// Fails to compile when a member is added: describe it in the header, then count it here.
[[maybe_unused]] void name_all_members(Cell& c, Table& t, Figure& f, Fact& a, Headline& h, HeadlineGroup& g,
                                       Known& k, Section& s, Page& p) {
  [[maybe_unused]] const auto& [c1, c2, c3, c4] = c;
  [[maybe_unused]] const auto& [t1, t2, t3, t4, t5, t6, t7, t8] = t;
  [[maybe_unused]] const auto& [f1, f2, f3, f4, f5] = f;
  [[maybe_unused]] const auto& [a1, a2] = a;
  [[maybe_unused]] const auto& [h1, h2] = h;
  [[maybe_unused]] const auto& [g1, g2] = g;
  [[maybe_unused]] const auto& [k1, k2, k3] = k;
  [[maybe_unused]] const auto& [s1, s2, s3, s4, s5, s6, s7, s8] = s;
  [[maybe_unused]] const auto& [p1, p2, p3, p4, p5, p6, p7, p8, p9, p10] = p;
}

}  // namespace

metrics::DocumentHead head_from(const nlohmann::json& document) {
  metrics::DocumentHead head;
  document.at("version").get_to(head.version);
  document.at("commit").get_to(head.commit);
  document.at("build").get_to(head.build);
  const nlohmann::json& machine = document.at("machine");
  metrics::visit_machine([&](const char* key, auto& value) { machine.at(key).get_to(value); }, head.machine);
  document.at("started_utc").get_to(head.started_utc);
  document.at("command").get_to(head.command);
  return head;
}

void put_scripts(std::vector<Section>& sections) {
  for (Section& section : sections)
    for (Figure& figure : section.figures)
      if (!figure.svg.empty()) figure.svg = fmt::format("{}/{}.gp", kFigures, figure.name);
}

Status draw_scripts(std::vector<Section>& sections, const OutputFolder& folder) {
  for (Section& section : sections)
    for (Figure& figure : section.figures) {
      if (figure.svg.empty()) continue;
      PALPATE_ASSIGN(const OutputFolder figures, folder.inside(kFigures));
      figure = drawn_again(std::move(figure), figures);
    }
  return Done{};
}

Status keep_page(const Page& page, const OutputFolder& folder) {
  Page kept = page;
  put_scripts(kept.sections);
  DocumentJson document = begin_json(kPageSchema, page.about);
  document.update(DocumentJson(nlohmann::json(kept)));
  PALPATE_TRY(folder.write(kPageFile, document_text(document)));
  return write_page(page, folder);
}

Status draw_again(const OutputFolder& folder, const char* name, const char* schema,
                  const std::function<Result<Page>(const nlohmann::json&)>& page) {
  const std::string file = folder.file(name).string();
  const auto wrong = [&](const std::string& what) {
    return Error{what, "run the command that wrote this folder again", file};
  };
  PALPATE_ASSIGN(const std::string text, read_file(file, kMemoryLimitBytes));
  try {
    const nlohmann::json document = nlohmann::json::parse(text);
    if (document.at("schema") != schema) return wrong(fmt::format("is not of schema {}", schema));
    PALPATE_ASSIGN(const Page drawn, page(document));
    return write_page(drawn, folder);
  } catch (const nlohmann::json::exception& error) {
    return wrong(fmt::format("cannot be drawn again: {}", error.what()));
  }
}

Status draw_kept_page(const OutputFolder& folder) {
  return draw_again(folder, kPageFile, kPageSchema, [&](const nlohmann::json& document) -> Result<Page> {
    Page page = document.get<Page>();
    page.about = head_from(document);
    PALPATE_TRY(draw_scripts(page.sections, folder));
    return page;
  });
}

}  // namespace palpate::experiments
