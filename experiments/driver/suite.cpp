#include "experiments/driver/suite.h"

#include <fmt/format.h>

#include <cstdio>

#include "experiments/driver/json_document.h"
#include "experiments/session/terminal.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {

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
  PALPATE_ASSIGN(folder_, OutputFolder::open(out));
  return folder_->check_not_read(read);
}

Status Suite::begin(const RunKey& key) {
  context_.working = true;
  return begin_run(*folder_, key.word(), context_);
}

Status Suite::publish(const SuiteResults& results, const Page& page, bool json) const {
  PALPATE_TRY(folder_->write(results.file, results.json));
  PALPATE_TRY(write_page(page, *folder_));
  PALPATE_TRY(folder_->complete());
  progress().clear();
  if (json)
    fmt::print("{}", results.json);
  else
    print_tables(results.tables, context_.verbose);
  std::fflush(stdout);
  for (const std::string& warning : results.warnings) tell("palpate: warning: {}\n", warning);
  if (!json) fmt::print("report: {}\n", std::filesystem::absolute(folder_->file(kReportFile)).string());
  return Done{};
}

}  // namespace palpate::experiments
