# cmake -DPROGRAM=counted_work -DWORK=decode -DCOUNTS=counts.txt -DBUILD_TYPE=Release -P check_count.cmake
# Fails where the instructions of the work are more than 5 % off the file's figure, in either direction: a gain is written
# down too, so that it is not lost again unseen. The same binary gives the same count but for the library's start and the
# compiler's patch level, some tenths of a percent.
set(tolerance_percent 5)
find_program(VALGRIND valgrind)
if(NOT VALGRIND)
  message(STATUS "left out: valgrind is not installed, instructions are not counted")
  return()
endif()
if(NOT BUILD_TYPE STREQUAL Release)
  message(STATUS "left out: instructions are counted of the release build only")
  return()
endif()
file(STRINGS ${COUNTS} lines REGEX "^${WORK} ")
list(GET lines 0 line)
string(REGEX REPLACE "^${WORK} +([0-9]+).*" "\\1" expected "${line}")
# One thread, and the mathematical library's plain functions: not those of the processor that happens to be here.
set(ENV{FRINGECAL_THREADS} 1)
set(ENV{GLIBC_TUNABLES} "glibc.cpu.hwcaps=-AVX512F,-AVX2,-FMA,-FMA4,-AVX")
execute_process(COMMAND ${VALGRIND} --tool=callgrind --toggle-collect=counted_work --callgrind-out-file=/dev/null
                        ${PROGRAM} ${WORK}
                OUTPUT_VARIABLE output ERROR_VARIABLE errors RESULT_VARIABLE result)
if(NOT result EQUAL 0 OR NOT errors MATCHES "Collected : ([0-9]+)")
  message(FATAL_ERROR "${WORK}: valgrind ended with ${result}\n${output}${errors}")
endif()
set(counted ${CMAKE_MATCH_1})
math(EXPR percent_times_100 "(${counted} - ${expected}) * 10000 / ${expected}")
message(STATUS "${WORK}: ${counted} instructions, ${expected} expected, ${percent_times_100} hundredths of a percent off")
math(EXPR limit "${tolerance_percent} * 100")
if(percent_times_100 GREATER limit OR percent_times_100 LESS -${limit})
  message(FATAL_ERROR "${WORK} takes ${counted} instructions, ${COUNTS} says ${expected} +- ${tolerance_percent} %. If the "
                      "change is meant, write the new figure there and its reason into the commit")
endif()
