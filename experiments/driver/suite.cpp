#include "experiments/driver/suite.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>

#include "experiments/driver/jobs.h"
#include "experiments/driver/page_document.h"
#include "experiments/session/terminal.h"
#include "toolkit/core/messages.h"

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

}  // namespace palpate::experiments
