#include "experiments/session/run_key.h"

#include <sys/stat.h>

#include <cstddef>
#include <span>
#include <vector>

#include "experiments/run/stage.h"
#include "experiments/session/version.h"
#include "toolkit/core/input_file.h"
#include "toolkit/metrics/machine_info.h"

namespace palpate::experiments {

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

}  // namespace palpate::experiments
