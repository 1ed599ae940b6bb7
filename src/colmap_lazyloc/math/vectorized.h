#pragma once

namespace lazyloc {

// Marks functions whose loops the compiler shall vectorise for AVX2. They must be inlined into RunWithAvx2, because a
// compiler uses only the instructions that the surrounding function allows.
#define LAZYLOC_ALWAYS_INLINE __attribute__((always_inline))

#if defined(__x86_64__)
template <typename Function>
__attribute__((target("avx2"))) void RunWithAvx2(const Function& function) {
  function();
}
#endif

// Runs a lambda that is LAZYLOC_ALWAYS_INLINE, with AVX2 if the processor has it.
template <typename Function>
void RunVectorized(const Function& function) {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2")) return RunWithAvx2(function);
#endif
  function();
}

}  // namespace lazyloc
