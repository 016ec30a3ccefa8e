function [value, sd] = fit_procest(t, u, position)
% FIT_PROCEST  Gain, an integrator, one pole and a delay on the position, with the input's offset as a parameter.
%
%   value = [K tau], sd their standard deviations as the toolbox states them. Not run under MATLAB; see run_peers.
data = iddata(position - position(1), u, t(2) - t(1));
options = procestOptions('InitialCondition', 'estimate', 'InputOffset', 'estimate');
model = procest(data, 'P1ID', options);
[parameters, deviations] = getpvec(model);
at = [find(parameters == model.Kp, 1), find(parameters == model.Tp1, 1)];
value = parameters(at).';
sd = deviations(at).';
end
