#include "memory.hpp"

#include <fstream>
#include <malloc.h>
#include <new>
#include <string>
#include <sys/resource.h>
#include <unistd.h>

namespace trailmark {
namespace {

constexpr double kSecondThread = 16.0;  // MB for the stack of the second thread that PRM starts

// Says why the program ends, should the exception not be caught: OMPL's PRM ends it when one passes its threads.
void out_of_memory() {
  static constexpr char kText[] = "bad_alloc: out of memory\n";
  [[maybe_unused]] const auto written = write(STDERR_FILENO, kText, sizeof kText - 1);
  throw std::bad_alloc();
}

// A row of /proc/self/status, in MB.
double status_row(const std::string& name) {
  std::ifstream file("/proc/self/status");
  for (std::string word; file >> word;) {
    if (word == name) {
      double kilobytes = -1.0;
      file >> kilobytes;
      return file ? kilobytes / 1024.0 : -1.0;
    }
  }
  return -1.0;
}

}  // namespace

double restart_memory_peak() {
  std::ofstream("/proc/self/clear_refs") << "5";
  return status_row("VmRSS:");
}

double memory_peak() { return status_row("VmHWM:"); }

void limit_memory(double megabytes) {
  const double mapped = status_row("VmSize:");
  if (mapped < 0.0) {
    return;
  }
  // Else the second thread's first allocation would set 64 MB or more of address space aside.
  mallopt(M_ARENA_MAX, 1);
  const auto bytes = static_cast<rlim_t>((mapped + megabytes + kSecondThread) * 1024.0 * 1024.0);
  const rlimit limit{bytes, bytes};
  setrlimit(RLIMIT_AS, &limit);
  std::set_new_handler(out_of_memory);
}

}  // namespace trailmark
