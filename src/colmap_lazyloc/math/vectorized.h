#pragma once

namespace lazyloc {

// Compilers make vector instructions of plain loops, those that the function may use into which the loops are inlined.
#define LAZYLOC_ALWAYS_INLINE __attribute__((always_inline))

#if defined(__x86_64__)
template <typename Function>
__attribute__((target("avx2"))) void RunWithAvx2(const Function& function) {
  function();
}
#endif

// Runs a lambda that is LAZYLOC_ALWAYS_INLINE, with the processor's larger vectors where it has them.
template <typename Function>
void RunVectorized(const Function& function) {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2")) return RunWithAvx2(function);
#endif
  function();
}

}  // namespace lazyloc
