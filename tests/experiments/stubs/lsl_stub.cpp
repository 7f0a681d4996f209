// A library with the functions of Lab Streaming Layer that Palpate calls: it writes what it is asked into the
// file that LSL_STUB_FILE names. Not liblsl: of that it has the names alone.
#include <cstdint>
#include <cstdio>
#include <cstdlib>

namespace {

struct Stub {
  int dummy = 0;
};
Stub info, outlet;

void write_line(const char* what, const char* text, double number) {
  const char* const name = std::getenv("LSL_STUB_FILE");
  if (name == nullptr) return;
  if (std::FILE* const file = std::fopen(name, "a")) {
    std::fprintf(file, "%s;%s;%.6f\n", what, text, number);
    std::fclose(file);
  }
}

}  // namespace

extern "C" {

void* lsl_create_streaminfo(const char* name, const char* type, std::int32_t channels, double rate,
                            std::int32_t format, const char* source) {
  write_line("name", name, channels);
  write_line("type", type, rate);
  write_line("source", source, format);
  return &info;
}
void* lsl_create_outlet(void* given, std::int32_t /*chunk*/, std::int32_t /*buffered*/) {
  return given == &info ? &outlet : nullptr;
}
std::int32_t lsl_push_sample_strt(void* given, const char** sample, double time) {
  if (given != &outlet) return -1;
  write_line("sample", *sample, time);
  return 0;
}
double lsl_local_clock() {
  return 1000.0;
}
void lsl_destroy_outlet(void* /*given*/) {
  write_line("end", "outlet", 0.0);
}
void lsl_destroy_streaminfo(void* /*given*/) {
  write_line("end", "info", 0.0);
}

}  // extern "C"
